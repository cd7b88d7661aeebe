"""Baselines for comparison with recovery: methods that find strokes in a picture."""
