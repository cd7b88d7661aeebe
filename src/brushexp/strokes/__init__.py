"""Define strokes: their parameters and units, the mathematics of their curves, and which strokes are valid."""
