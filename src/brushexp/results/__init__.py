"""Collect runs in one table, and write plots, tables and a sheet of their pictures."""
