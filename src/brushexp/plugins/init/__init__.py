"""Initialisers: target picture -> initial strokes. Choose one: ``init=slic``."""
