"""Density policies decide when to add and remove strokes; choose one with ``density=fixed``."""
