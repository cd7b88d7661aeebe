"""A network that recognises valid strokes, and the loss that asks it."""
