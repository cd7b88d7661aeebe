"""Compute features of regions for their confidence, and measure the calibration of confidences."""
