"""Layers for networks that draw strokes."""

from brushexp.plugins.renderer._layers import CoordConv, Noise, add_noise, fixed_grain, window_planes

__all__ = ["CoordConv", "Noise", "add_noise", "fixed_grain", "window_planes"]
