"""Pictures to learn from -> weights: training through the renderer."""
