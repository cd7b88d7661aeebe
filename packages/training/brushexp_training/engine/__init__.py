"""Brush simulators: the family ``engine``."""
