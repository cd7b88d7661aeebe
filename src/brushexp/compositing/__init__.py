"""Strokes laid over each other, tile by tile: the kernels and their reference, which the blends use."""
