"""Superpixels go in; a merge tree of regions, and its best cut into strokes, come out."""
