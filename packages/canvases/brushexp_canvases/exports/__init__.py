"""Exporters that write image pyramids."""
