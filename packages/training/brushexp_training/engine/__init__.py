"""Brush simulators, which are plugins of the family ``engine``."""
