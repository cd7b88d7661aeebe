"""Fit a quadratic Bezier curve with a width to each region, then refine all curves jointly.

The folder also computes the coverage of round-ended lines along such curves, for drawing and comparing strokes.
"""
