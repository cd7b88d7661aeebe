"""Brush simulators, as members of the family ``engine``."""
