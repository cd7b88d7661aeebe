"""Palettes: colours of the picture -> colours of the target. Choose one: ``palette=muted``."""
