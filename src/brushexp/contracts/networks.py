"""Layers that networks which draw strokes are made of."""

from brushexp.plugins.renderer._layers import CoordConv, Noise, add_noise, fixed_grain, window_planes

__all__ = ["CoordConv", "Noise", "add_noise", "fixed_grain", "window_planes"]
