"""Measure a renderer's accuracy on held-out strokes and its speed."""
