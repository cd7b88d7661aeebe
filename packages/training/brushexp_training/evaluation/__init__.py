"""Measure a renderer's speed and its accuracy on held-out strokes."""
