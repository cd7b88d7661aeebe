"""Painters: target picture -> strokes, state by state. Choose one: ``painter=gradient``."""
