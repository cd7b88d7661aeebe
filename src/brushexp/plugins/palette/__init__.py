"""Palettes: colours of the picture -> colours of the target. Pick one: ``palette=muted``."""
