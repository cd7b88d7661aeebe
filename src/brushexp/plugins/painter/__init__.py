"""Painters turn a target into strokes, state by state; choose one with ``painter=gradient``."""
