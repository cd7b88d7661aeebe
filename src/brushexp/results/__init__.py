"""Collect runs into one table; write plots, tables and a sheet of pictures of them."""
