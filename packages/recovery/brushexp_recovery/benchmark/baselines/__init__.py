"""Baselines for comparison with recovery, each of which finds strokes in a picture."""
