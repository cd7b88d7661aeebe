"""Density policies: when to add and remove strokes. Choose one: ``density=fixed``."""
