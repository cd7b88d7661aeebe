"""Define a stroke: its numbers and units, the mathematics of its curve, and which strokes are valid."""
