"""Painters: a picture -> strokes, state after state. Pick one: ``painter=gradient``."""
