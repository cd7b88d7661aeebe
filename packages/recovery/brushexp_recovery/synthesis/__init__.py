"""A seed and a subject go in; a painting whose strokes are known, with the truth of what is seen where, comes out."""
