"""Exporters (``to=``) for email, print, films, reliefs, tables and machines."""
