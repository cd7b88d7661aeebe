"""Marks that people drew go in; their regions, and how far two sets of strokes agree, come out."""
