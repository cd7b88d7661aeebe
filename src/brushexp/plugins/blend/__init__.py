"""Blends: strokes in depth order -> the picture. Pick one: ``blend=tiled``."""
