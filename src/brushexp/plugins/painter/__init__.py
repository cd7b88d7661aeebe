"""Painters: target picture -> strokes, state by state. Pick one: ``painter=gradient``."""
