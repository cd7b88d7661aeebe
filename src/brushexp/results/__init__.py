"""Collect runs in one table; write plots, tables and a sheet of their pictures."""
