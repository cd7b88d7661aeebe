"""Blends: composite strokes in depth order into a picture. Choose one: ``blend=tiled``."""
