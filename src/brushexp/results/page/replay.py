"""Strokes as a page takes them: packed into few bytes each, from which a canvas draws them again."""

from __future__ import annotations

import base64
import math
from functools import lru_cache
from typing import Any

import numpy as np
import yaml  # type: ignore[import-untyped,unused-ignore]

from brushexp.analysis.measures import Measures
from brushexp.strokes.bezier import curve_of
from brushexp.strokes.storage import Saved

MAX_STROKES = 200_000  # strokes: more make a page that browsers choke on
STEPS = 65_535  # of 16 bits
NO_DIRECTION = STEPS  # of a dot
FARTHEST = 4.0  # canvas sides: control points farther out are moved to there, since 16 bits must do for all
CANVAS_RENDERER = "analytic"  # whose strokes a canvas can draw
DEFAULT_SOFT = 2.0  # pixels: edge of strokes whose renderer has no such option


def replay_of(saved: Saved, measures: Measures) -> dict[str, Any] | None:
    """What ``strokes.js`` needs; None without strokes, and for more than ``MAX_STROKES``.

    ``data`` holds, for the strokes from the bottom to the top, one array after the other, little-endian, in base64
    (27 bytes a stroke): number in the catalogue (uint32); x and y of the three control points, between the corners of
    ``box`` (6 uint16); full width as a share of ``widest``, length of ``longest`` (uint16 each); direction as a share
    of half a turn, 65535 for none (uint16); red, green, blue, opacity (4 uint8); visible share (uint8). Lengths are
    in pixels of the canvas.

    Args:
        saved: the catalogue.
        measures: of its strokes.
    """
    count = len(saved.strokes)
    if not 0 < count <= MAX_STROKES:
        return None
    order = saved.depth.argsort().numpy()
    height, width = saved.size
    points = curve_of(saved.strokes).numpy().astype(np.float64)[order]  # (N, 3, 2)
    far = FARTHEST * max(height, width)
    low = np.maximum(points.min((0, 1)).clip(max=0), -far)
    high = np.minimum(points.max((0, 1)).clip(min=(width, height)), (width + far, height + far))
    widest, longest = (float(values.max().clip(1e-6, 2 * far)) for values in (measures.width, measures.length))
    turn = np.where(np.isfinite(measures.orientation), measures.orientation / math.pi * (STEPS - 1), NO_DIRECTION)
    paint = np.concatenate([saved.strokes.color.numpy(), saved.strokes.opacity.numpy()[:, None]], axis=1)
    arrays = [
        order.astype("<u4"),
        _shares((points - low) / (high - low), STEPS, "<u2"),
        _shares(measures.width[order] / widest, STEPS, "<u2"),
        _shares(measures.length[order] / longest, STEPS, "<u2"),
        turn[order].round().astype("<u2"),
        _shares(paint[order], 255, "u1"),
        _shares(measures.visible[order], 255, "u1"),
    ]
    return {
        "count": count,
        "width": width,
        "height": height,
        "background": hex_of(saved.background.numpy()),
        "box": [*low.tolist(), *high.tolist()],
        "widest": widest,
        "longest": longest,
        **_edges(saved),
        "layers": np.quantile(measures.area, [1 / 3, 2 / 3]).tolist(),
        "exact": saved.renderer == CANVAS_RENDERER,
        "data": base64.b64encode(b"".join(array.tobytes() for array in arrays)).decode(),
    }


def _edges(saved: Saved) -> dict[str, float]:
    """Soft edge in pixels and taper of the renderer, as far as its options have them."""
    node = recorded_config(saved.config).get("renderer")
    options = node if isinstance(node, dict) else {}
    found = {"soft": DEFAULT_SOFT, "taper": 0.0}
    given = {name: options.get(name) for name in found}
    return found | {
        name: float(value)
        for name, value in given.items()
        if isinstance(value, int | float) and math.isfinite(value) and value >= 0
    }


@lru_cache(maxsize=4)
def recorded_config(config: str) -> dict[str, Any]:
    """The YAML of a run's config as plain data; nothing if it is not such, for the file may come from elsewhere."""
    try:
        found = yaml.safe_load(config)
    except (yaml.YAMLError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def hex_of(color: np.ndarray) -> str:
    """A colour (3,) in [0, 1] as ``#rrggbb``."""
    return "#" + "".join(f"{level:02x}" for level in _shares(color, 255, "u1").tolist())


def _shares(values: np.ndarray, steps: int, kind: str) -> np.ndarray:
    """Numbers in [0, 1] as whole numbers from 0 to ``steps``."""
    return (np.nan_to_num(values).clip(0, 1) * steps + 0.5).astype(kind)  # halves upwards, as in files.to_bytes
