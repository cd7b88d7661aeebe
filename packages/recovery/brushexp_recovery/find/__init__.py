"""Find the regions of the strokes in a photograph of any size by the agreement of several looks at each part."""
