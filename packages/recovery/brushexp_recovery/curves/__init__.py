"""Fit quadratic Bezier curves with a width to regions, first individually, then all curves jointly.

The folder also computes the coverage of round-ended lines along such curves, for drawing and comparing strokes.
"""
