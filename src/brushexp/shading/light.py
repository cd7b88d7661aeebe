"""Shade a height map with normals, diffuse and specular light.

The browser uses the same formula. Its axes are x to the right, y upwards and z towards the viewer, but the rows y of a
picture run downwards. A is the azimuth of the light, clockwise from the top (315 is the upper left); E is its
elevation above the canvas; c is a colour of the painting in [0, 1]; h are heights in pixels, with edge values repeated
beyond the edges:

    gx = depth (h[y, x + 1] - h[y, x - 1]) / 2        gy = depth (h[y + 1, x] - h[y - 1, x]) / 2
    n  = (-gx, gy, 1) / sqrt(gx^2 + gy^2 + 1)         the normal
    l  = (sin A cos E, cos A cos E, sin E)            direction to the light
    m  = (l + (0, 0, 1)) / |l + (0, 0, 1)|            halfway between light and viewer
    d  = 1 + DIRECT (max(n . l, 0) / sin E - 1)       diffuse light, 1 on a flat canvas
    k  = d^(1 / GAMMA)                                diffuse light for display-referred colours
    s  = max((n . m)^SHININESS - m_z^SHININESS, 0)    specular light, 0 on a flat canvas
    lit = c k if k <= 1, else 1 - (1 - c)^k
    out = lit + gloss s (1 - lit)

A flat canvas therefore keeps its colours exactly, and no colour is ever clipped.

Source: Lambert (1760); highlights as in Blinn, "Models of light reflection for computer synthesized pictures" (1977);
normals of a height map as in Blinn, "Simulation of wrinkled surfaces" (1978); angles as in cartography (Horn, "Hill
shading and the reflectance map", 1981). Differs from the sources: light is relative to a flat canvas; it never
brightens colours beyond white; nothing casts shadows.
"""

import math
from dataclasses import dataclass

import numpy as np

from brushexp.bounds import Bounds, above, between

DIRECT = 0.7  # fraction of the diffuse light that comes from the lamp; the rest is ambient
SHININESS = 24.0  # oil paint; a highlight is visible where the surface is tilted up to 14 degrees from it
GAMMA = 2.2  # gamma of displays; light is multiplied in physical units
BOUNDS = {  # of `Light`
    "azimuth": Bounds(typical=315),
    "elevation": above(0, 90, typical=45),
    "depth": between(0, 1000, typical=1),
    "gloss": between(0, 1, typical=0.25),
}
Array = np.ndarray


@dataclass(frozen=True)
class Light:
    """The lamp over a painting: its direction, and the thickness and gloss of the paint."""

    azimuth: float = 315.0  # degrees clockwise from the top (315: upper left)
    elevation: float = 45.0  # degrees above the canvas
    depth: float = 0.0  # thickness of the paint: 1 is natural, 0 is flat and unlit
    gloss: float = 0.25  # gloss of the paint, 0 (matt) to 1 (wet)

    @property
    def direction(self) -> Array:
        """Return the unit vector (3,) float32 towards the lamp; its axes point right, up and towards the viewer."""
        azimuth, elevation = math.radians(self.azimuth), math.radians(self.elevation)
        flat = math.cos(elevation)
        return np.array([math.sin(azimuth) * flat, math.cos(azimuth) * flat, math.sin(elevation)], np.float32)


UNLIT = Light()


def normals_of(height: Array, scale: float = 1.0, rows: slice = slice(None)) -> Array:
    """Compute unit normals (3, h, W) for ``rows`` of heights (H, W) times ``scale``: right, up, towards the viewer."""
    chosen = range(len(height))[rows]
    around = np.clip(np.arange(chosen.start - 1, chosen.stop + 1), 0, len(height) - 1)
    padded = np.pad(height[around], ((0, 0), (1, 1)), mode="edge")
    half = np.float32(0.5 * scale)
    gx = (padded[1:-1, 2:] - padded[1:-1, :-2]) * half
    gy = (padded[2:, 1:-1] - padded[:-2, 1:-1]) * half
    return np.stack([-gx, gy, np.ones_like(gx)]) / np.sqrt(gx * gx + gy * gy + 1)


def shade_picture(color: Array, normals: Array, light: Light) -> Array:
    """Shade a display-referred picture (3, H, W) in [0, 1] with the formula in the module's docstring."""
    to_light = light.direction
    halfway = to_light + np.array([0, 0, 1], np.float32)
    halfway /= np.linalg.norm(halfway)
    diffuse = 1 + DIRECT * (np.maximum(np.tensordot(to_light, normals, 1), 0) / to_light[2] - 1)
    shine = np.maximum(np.tensordot(halfway, normals, 1), 0) ** SHININESS - halfway[2] ** SHININESS
    color, k = np.clip(color, 0, 1), diffuse ** (1 / GAMMA)
    lit = np.where(k <= 1, color * k, 1 - (1 - color) ** np.maximum(k, 1))
    return lit + light.gloss * np.maximum(shine, 0) * (1 - lit)


def overlay(flat: Array, finished: Array) -> Array:
    """Compute the overlay (H, W, 4) of light and bare paper that turns ``flat`` (H, W, 3) into ``finished``, all uint8.

    Each pixel of the overlay is as transparent as possible. Its colour is black in the shade, and close to the
    ground's colour where paint skips the paper.
    """
    below, above = flat.astype(np.float32) / 255, finished.astype(np.float32) / 255
    change = above - below
    room = np.where(change > 0, 1 - below, below)  # distance to white or to black
    share = (np.abs(change) / np.maximum(room, 1e-6)).max(-1, keepdims=True)
    share = np.ceil(255 * share.clip(0, 1) - 1e-3) / 255
    color = below + change / np.maximum(share, 1 / 255)
    return (255 * np.concatenate([color.clip(0, 1) * (share > 0), share], axis=-1) + 0.5).astype(np.uint8)
