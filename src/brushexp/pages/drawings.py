"""Compute the figures on a run's page as plain data: charts for ``run_charts.js``, swatches, error and height maps.

Each chart has a ``kind``, a ``title``, a ``summary`` for browsers without scripts, and the data for that kind.
"""

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from PIL import Image

from brushexp.pages.html import embed
from brushexp.pictures.color import hex_of, nearest_ink, palette, to_lab
from brushexp.plugins.export.base import ExportJob
from brushexp.registry import build_named
from brushexp.results.stroke_table import DIRECTION_BINS, direction_shares

MAX_POINTS = 400  # maximum number of points of a line
BINS = 28
TAIL_QUANTILE = 0.99  # quantile beyond which values share the last bar
SWATCHES = 12
SMALLEST_SHARE = 0.002  # smallest share of a colour with a swatch
COARSE_LEVELS = 31  # levels per channel in which swatches are clustered
SCALE_ENDS = (4, 8, 16, 32, 64, 128, 255)  # levels at which the scale of an error map may end
SHARE_ON_SCALE = 0.995  # smallest share of the pixels that lie on the scale
# Magma by Smith and van der Walt (2015) in equal steps: perceptually uniform, also in grey and for the colour-blind.
MAGMA = (
    "#000004", "#180f3e", "#451077", "#721f81", "#9f2f7f", "#cd4071", "#f1605d", "#fd9567", "#fec98d", "#fcfdbf",
)  # fmt: skip
MAP_SIDE = 512  # pixels on the longer side of the height map


def line_chart(
    title: str, x: Sequence[float] | np.ndarray, y: Sequence[float] | np.ndarray, x_label: str, unit: str = ""
) -> dict | None:
    """Return a line chart of ``y`` over increasing ``x``.

    Returns None if there are fewer than two finite points, if ``x`` is constant or if the lengths differ.
    """
    if len(x) != len(y):  # users may have edited the table
        return None
    points = np.array([x, y], float)
    points = points[:, np.isfinite(points).all(0)]
    if points.shape[1] < 2 or points[0, 0] == points[0, -1]:
        return None
    some = points[:, np.linspace(0, points.shape[1] - 1, min(points.shape[1], MAX_POINTS)).round().astype(int)]
    first, last = (f"{value:.4g}" for value in points[1, [0, -1]])
    return {
        "kind": "line",
        "title": f"{title}, {unit}" if unit else title,
        "summary": f"{title}: from {first} to {last} {unit}".rstrip() + f" at {points[0, -1]:,.6g} {x_label}",
        "x": _round_values(some[0]),
        "y": _round_values(some[1]),
        "x_label": x_label,
        "unit": unit,
    }


def histogram_chart(title: str, values: np.ndarray, x_label: str) -> dict | None:
    """Return a histogram of nonnegative stroke ``values`` (N,) and their median, or None if no value is finite."""
    values = values[np.isfinite(values)]
    if not len(values):
        return None
    largest, median = float(values.max()), float(np.median(values))
    end = float(np.quantile(values, TAIL_QUANTILE)) or largest or 1.0
    if largest < 1.15 * end:
        end = largest or 1.0
    counts, _ = np.histogram(np.minimum(values, end), BINS, (0.0, end))
    summary = f"{title}: half of the strokes are below {median:.3g}; {x_label}"
    chart = {"kind": "histogram", "title": title, "summary": summary, "x_label": x_label}
    return chart | {"counts": counts.tolist(), "end": end, "largest": largest, "median": median}


def rose_chart(title: str, angles: np.ndarray, lengths: np.ndarray) -> dict | None:
    """Return a rose chart of stroke directions weighted by length, or None if no stroke has a direction.

    ``angles`` (N,) are in radians and NaN for strokes without a direction; ``lengths`` has shape (N,).
    """
    directed = np.isfinite(angles) & (lengths > 0)
    if not directed.any():
        return None
    shares = direction_shares(np.degrees(angles[directed]), lengths[directed])
    peak = 180 * int(shares.argmax()) / DIRECTION_BINS
    return {
        "kind": "rose",
        "title": title,
        "summary": f"Directions: most of the length lies near {peak:.0f} degrees",
        "shares": _round_values(shares),
        "note": "Share of the strokes' length by direction, clockwise from horizontal: 45° falls to the right.",
    }


def _round_values(values: np.ndarray) -> list[float]:
    return [float(f"{value:.6g}") for value in values]


def swatches_of(colors: np.ndarray, weights: np.ndarray) -> list[dict[str, Any]]:
    """Cluster weighted sRGB colours (N, 3) in CIELAB; return up to ``SWATCHES`` colours and shares, darkest first."""
    colors, weights = colors[weights > 0], weights[weights > 0]
    if not len(weights):
        return []
    coarse, place = np.unique((colors * COARSE_LEVELS).round(), axis=0, return_inverse=True)
    centers = palette(to_lab(coarse / COARSE_LEVELS), np.bincount(place.ravel(), weights), SWATCHES)
    label = nearest_ink(to_lab(colors), centers)
    mass = np.bincount(label, weights, len(centers))
    sums = np.stack([np.bincount(label, weights * channel, len(centers)) for channel in colors.T], axis=1)
    dark_first = [k for k in centers[:, 0].argsort(kind="stable") if mass[k] >= SMALLEST_SHARE * mass.sum()]
    return [{"color": hex_of(sums[k] / mass[k]), "share": float(mass[k] / mass.sum())} for k in dark_first]


def error_map(painting: np.ndarray, target: np.ndarray) -> dict[str, Any]:
    """Map the absolute difference between two pictures (H, W, 3) uint8, averaged over channels, in levels (0 to 255).

    ``pixels`` (H, W, 3) uint8 shows the map in the colours of ``scale``, which ends at ``top`` levels. ``above`` is the
    fraction of pixels above ``top``, and ``mean`` is the mean difference in levels. Each pair in ``below`` gives a
    fraction of the pixels in words ("half", "90 %", ...) and the level that they do not exceed.
    """
    difference = np.abs(painting.astype(np.int16) - target).sum(2)  # thirds of a level, 0 to 765
    shares = (0.5, 0.9, 0.99, 1.0, SHARE_ON_SCALE)
    *levels, end = (np.quantile(difference, shares, method="inverted_cdf") / 3).tolist()
    top = next(level for level in SCALE_ENDS if level >= end)
    anchors = np.array([[*bytes.fromhex(color[1:])] for color in MAGMA], float)
    places = np.linspace(0, 3 * top, len(MAGMA))
    colors = np.stack([np.interp(np.arange(766), places, channel) for channel in anchors.T], axis=1)
    return {
        "pixels": colors.round().astype(np.uint8)[difference],
        "scale": MAGMA,
        "top": top,
        "above": float((difference > 3 * top).mean()),
        "mean": float(difference.mean() / 3),
        "below": list(zip(("half", "90 %", "99 %", "all"), levels, strict=True)),
    }


def height_map(job: ExportJob) -> dict[str, Any]:
    """Encode the height of the paint as a picture for ``light.js``.

    A height is ``top`` * (256 red + green) / 65535, in pixels of the map. ``light`` is the painting's light, with depth
    1 if the painting is unlit. ``drawn_as`` names the fast renderer that replaces a slow renderer, or is None.
    """
    drawn_as = job.renderer.warm_up
    renderer = job.renderer if drawn_as is None else build_named("renderer", drawn_as, {})
    small = replace(job, renderer=renderer, blend=build_named("blend", "tiled", {})).at_most(MAP_SIDE)
    paint, light = small.height().clip(0), job.light if job.light.depth else replace(job.light, depth=1.0)
    top = float(paint.max()) or 1.0
    levels = (paint / top * 65_535).round().astype(np.uint16)
    channels = np.stack([levels >> 8, levels & 255, np.zeros_like(levels)], axis=2).astype(np.uint8)
    (height, width), picture = job.size, embed(Image.fromarray(channels), MAP_SIDE)
    lamp = {"drawn_as": drawn_as, "light": asdict(light)}
    return {"source": picture["source"], "top": top, "width": width, "height": height, **lamp}
