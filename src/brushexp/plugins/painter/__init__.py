"""Painters approximate a target with strokes, in a sequence of states; choose one with ``painter=gradient``."""
