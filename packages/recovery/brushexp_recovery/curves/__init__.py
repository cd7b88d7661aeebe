"""Regions go in; quadratic Bezier curves with a width come out, fitted one by one and then refined together.

The folder also says what round-ended lines along such curves cover, for whatever draws or compares strokes.
"""
