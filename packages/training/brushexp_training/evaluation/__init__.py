"""How good a renderer is on strokes that it has not seen, and how fast."""
