"""A seed and a subject go in; a painting comes out, with the truth about its strokes."""
