"""Compute region features from which confidence is predicted, and measure how well confidences are calibrated."""
