"""Initialisers: target picture -> initial strokes. Pick one: ``init=slic``."""
