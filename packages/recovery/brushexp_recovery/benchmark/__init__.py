"""Paintings with known strokes, and strokes that any method finds in them, go in; scores and a report come out."""
