"""Blends composite strokes in depth order into a picture; choose one with ``blend=tiled``."""
