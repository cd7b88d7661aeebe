"""Exporters for mail, print, film, relief, tables and machines, as members of the family ``to``."""
