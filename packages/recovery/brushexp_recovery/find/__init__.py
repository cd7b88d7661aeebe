"""A photograph of any size goes in; the regions of its strokes come out, on which several looks at it agree."""
