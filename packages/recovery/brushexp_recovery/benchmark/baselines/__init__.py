"""Baselines for recovery: other methods that find strokes in a picture."""
