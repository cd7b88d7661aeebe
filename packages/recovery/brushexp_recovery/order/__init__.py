"""Find the order of strokes, bottom to top, from their regions and curves."""
