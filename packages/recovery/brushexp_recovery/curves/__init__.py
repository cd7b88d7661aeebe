"""Regions go in; quadratic Bezier curves with a width come out, fitted to each region and then to what is seen of all.

Here is also what round-ended lines along such curves cover, for all that draws or compares strokes.
"""
