"""Palettes map the colours of a picture to those of the target; choose one with ``palette=muted``."""
