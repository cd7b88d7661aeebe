"""Palettes: colours of the picture -> colours of the painting. Pick one: ``palette=muted``."""
