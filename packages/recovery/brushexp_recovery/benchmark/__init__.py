"""Paintings with known strokes and anybody's strokes of them go in; scores, tables and plots come out."""
