"""What a stroke is: its numbers and units, the mathematics of its curve, and which strokes are valid."""
