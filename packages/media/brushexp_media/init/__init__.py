"""Initialisers for media: place the initial strokes as in drawing, pastel or pointillism."""
