"""Exporters for email, print, film, relief, tables and machines: members of the family ``to``."""
