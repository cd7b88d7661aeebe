"""Collect runs in one table, and write plots, tables and a contact sheet of the paintings."""
