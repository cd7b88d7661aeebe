"""Compiled code, and the interface for rasterisers on other hardware."""

from brushexp.compat.compiled import Compiled, function, inline
from brushexp.compositing import frame, nearest, profile, textured_profile, textures, tile_lists
from brushexp.compositing.rasterization import Rasterizer
from brushexp.compositing.tile_lists import AREA, TILE

__all__ = [
    "AREA",
    "TILE",
    "Compiled",
    "Rasterizer",
    "frame",
    "function",
    "inline",
    "nearest",
    "profile",
    "textured_profile",
    "textures",
    "tile_lists",
]
