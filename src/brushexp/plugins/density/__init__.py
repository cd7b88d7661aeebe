"""Density policies: when strokes are added and removed. Pick one: ``density=fixed``."""
