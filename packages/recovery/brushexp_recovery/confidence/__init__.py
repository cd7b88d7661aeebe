"""Compute features of regions for predicting confidence, and measure the calibration of confidences."""
