"""Composite strokes tile by tile, with compiled kernels or with a reference implementation in eager PyTorch."""
