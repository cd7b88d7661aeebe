"""Brush simulators: stroke parameters -> a picture of one stroke. Pick one: ``engine=...``."""
