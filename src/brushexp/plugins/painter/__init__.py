"""Painters approximate a target with strokes, state by state; choose one with ``painter=gradient``."""
