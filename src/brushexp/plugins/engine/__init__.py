"""Brush simulators: stroke parameters -> a picture of one stroke. Choose one: ``engine=...``."""
