"""Fit quadratic Bezier curves with a width to regions, first one by one, and then refine all curves together.

The folder also computes the coverage of round-ended lines along such curves, for drawing and comparing strokes.
"""
