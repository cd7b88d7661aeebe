"""Regions and their curves go in; the order of the strokes, bottom to top, comes out."""
