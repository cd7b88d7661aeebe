"""Initialisers: a target picture -> the first strokes. Pick one: ``init=slic``."""
