"""Initialisers that place strokes as in ink drawings, pastels, pointillism and other media."""
