"""Palettes turn the colours of a picture into those of the target; choose one with ``palette=muted``."""
