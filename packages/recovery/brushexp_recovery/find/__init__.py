"""Find the regions of strokes in a photograph of any size, by comparing several predictions (looks) for each part."""
