"""Initialisers place the initial strokes on a target; choose one with ``init=slic``."""
