"""Exporters for email, print, films, reliefs, tables and machines: members of the family ``to``."""
