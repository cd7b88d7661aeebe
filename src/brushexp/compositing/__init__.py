"""Composite strokes tile by tile: the kernels that the blends use, and a reference in PyTorch."""
