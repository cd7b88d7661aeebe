"""Exporters that write pyramids."""
