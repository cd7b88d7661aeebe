"""Collect runs in one table; write plots, tables and a contact sheet of their pictures."""
