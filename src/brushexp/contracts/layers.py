"""Composite strokes as layers, tile by tile, and light their relief."""

from brushexp.compositing.bands import Drawer, cuts
from brushexp.compositing.eager import padded_lists, paint_tiles
from brushexp.compositing.layers import PAINT_REACH, SOFT_EDGE, SPREAD, Canvas, KernelInput, Layers, Size, accuracy_of
from brushexp.compositing.profile import DRIFTING, Profile
from brushexp.compositing.textured_profile import KERNEL, TexturedProfile
from brushexp.compositing.textures import TEXEL_ASPECT, Loop, Sheets, coordinates_of, sheets_of
from brushexp.shading.height import Impasto, surface_height, typical_width
from brushexp.shading.light import UNLIT, Light, normals_of, overlay, shade_picture

__all__ = [
    "DRIFTING",
    "KERNEL",
    "PAINT_REACH",
    "SOFT_EDGE",
    "SPREAD",
    "TEXEL_ASPECT",
    "UNLIT",
    "Canvas",
    "Drawer",
    "Impasto",
    "KernelInput",
    "Layers",
    "Light",
    "Loop",
    "Profile",
    "Sheets",
    "Size",
    "TexturedProfile",
    "accuracy_of",
    "coordinates_of",
    "cuts",
    "normals_of",
    "overlay",
    "padded_lists",
    "paint_tiles",
    "shade_picture",
    "sheets_of",
    "surface_height",
    "typical_width",
]
