"""Measure the strokes of a painting: their shapes (`strokes.measures`), visible shares and neighbours."""

import math
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.registry import name_of_target
from brushexp.strokes import measures as ruler
from brushexp.strokes.bezier import curve_of, half_width_of, length_of
from brushexp.strokes.catalogue import Strokes
from brushexp.strokes.measures import LI, NEIGHBOURS, Measure, pitch_of
from brushexp.strokes.saved import Saved, config_of

Array = NDArray[np.float64]
StrokeTable: TypeAlias = "np.recarray[Any, Any]"  # columns as attributes, see `measure_strokes`

RADIUS_PITCHES = 4.0  # pitches within which neighbours are counted, about 50 strokes
ALIGNED_WITHIN = math.radians(20)  # largest difference in direction between aligned strokes
LARGEST_CANVAS = 2**20  # pixels of the canvas on which visible shares are computed
THIN_FILM = 1e-4  # factor on opacities at which strokes hardly hide each other
DIRECTION_BINS = 18  # bins of 10 degrees
LEAST_PAINT = 1e-6  # pixels of paint below which a canvas counts as bare
SIZE_MEASURES = ("length", "width", "area", "elongatedness")  # measures that depend on the settings, not on the picture

MEASURES = ruler.MEASURES | {
    "deviation": Measure("spread of directions", "angular deviation sqrt((1 - coherence) / 2) near a stroke", LI, "°"),
    "visible": Measure("visible share", "share of the stroke's paint that no later stroke hides", high=1.0),
    "neighbours": Measure("neighbours", "number of strokes with centres within the radius", LI),
    "aligned": Measure(
        "aligned neighbours",
        f"of the {NEIGHBOURS} nearest, those that differ by {math.degrees(ALIGNED_WITHIN):.0f}° or less", LI,
    ),
}  # fmt: skip


@torch.no_grad()
def measure_strokes(strokes: Strokes, depth: Tensor, size: tuple[int, int], radius: float | None = None) -> StrokeTable:
    """Measure N strokes; all of them count as neighbours, so drop invisible ones first (`strokes.measures.is_visible`).

    ``depth`` (N,) holds ranks, 0 for the bottom stroke; ``size`` is the height and width of the canvas in pixels;
    neighbours are counted within ``radius`` pixels, or within ``RADIUS_PITCHES`` pitches if it is None.

    Returns:
        (N,) records of float64: the curve's centre x and y in pixels from the left and the top, and ``MEASURES``.
        Angles are in radians; orientation is measured clockwise, in [0, pi). Undefined measures are NaN: elongatedness
        if a stroke has no width; deviation, coherence and homogeneity if it has no neighbours; straightness and
        orientation if it is a dot, shorter than `ruler.POINT_LENGTH`. The length and curvature of dots are 0.
    """
    fine = strokes.map(Tensor.double)
    curve, width = curve_of(fine), 2 * half_width_of(fine)
    length, centre, direction = length_of(curve), ruler.centre_of(curve), ruler.direction_of(curve)
    near = ruler.nearest_strokes(centre, centre, exclude_self=True)
    dot, alone = length < ruler.POINT_LENGTH, torch.tensor(near.shape[1] == 0)
    coherence = ruler.coherence_of(direction, near).clamp_max(1).masked_fill(alone, torch.nan)
    likeness = (direction[:, None] * direction[near]).sum(-1)  # cosine of twice the angle between two directions
    aligned = (likeness >= math.cos(2 * ALIGNED_WITHIN)).sum(1)
    length = length.masked_fill(dot, 0)
    measures = {
        "x": centre[:, 0],
        "y": centre[:, 1],
        "length": length,
        "width": width,
        "area": ruler.area_of(length, width),
        "elongatedness": torch.where(width > 0, length / width, torch.nan),
        "straightness": ruler.straightness_of(curve, length).masked_fill(dot, torch.nan),
        "curvature": ruler.curvature_of(curve).masked_fill(dot, 0),
        "orientation": (0.5 * torch.atan2(direction[:, 1], direction[:, 0])).masked_fill(dot, torch.nan),
        "visible": visible_share(strokes, depth, size),
        "neighbours": _count_within(centre, RADIUS_PITCHES * pitch_of(strokes, size) if radius is None else radius),
        "aligned": aligned,
        "deviation": (0.5 * (1 - coherence)).sqrt(),
        "coherence": coherence,
        "homogeneity": ruler.homogeneity_of(width, near).masked_fill(alone, torch.nan),
    }
    columns = [value.double().numpy() for value in measures.values()]
    table = np.rec.fromarrays(columns, dtype=[(name, np.float64) for name in measures])
    table.orientation = table.orientation % math.pi % math.pi  # rounding turns a tiny negative angle into pi
    return table


def _count_within(centre: Tensor, radius: float) -> Tensor:
    """Count (N,) how many other centres lie within ``radius`` of each of the centres (N, 2)."""
    from scipy.spatial import cKDTree  # noqa: PLC0415  (slow to import)

    if not len(centre):
        return centre.new_zeros(0)
    return torch.from_numpy(cKDTree(centre.numpy()).query_ball_point(centre.numpy(), radius, return_length=True)) - 1


def visible_share(strokes: Strokes, depth: Tensor, size: tuple[int, int]) -> Tensor:
    """Compute the share (N,), 0 to 1, of each stroke's paint on the canvas that the strokes above leave visible.

    The share is sum(alpha T) / sum(alpha) over the pixels of the canvas, where T is the fraction of light that the
    strokes above transmit. Strokes are always drawn with ``renderer=analytic``. The picture is linear in each stroke's
    colour, so both sums are derivatives of the picture's brightness with respect to that colour. The second sum is
    computed with almost transparent strokes.
    """
    if not len(strokes):
        return torch.zeros(0)
    zoom = min(1.0, math.sqrt(LARGEST_CANVAS / (size[0] * size[1])))
    small = (max(1, round(size[0] * zoom)), max(1, round(size[1] * zoom)))
    moved = strokes.map(Tensor.float).moved(zoom=zoom)
    above = depth.argsort(descending=True)
    part = _paint_of(moved, above, small)
    whole = _paint_of(replace(moved, opacity=THIN_FILM * moved.opacity), above, small) / THIN_FILM
    return torch.where(whole > LEAST_PAINT, part / whole.clamp_min(LEAST_PAINT), 0.0).clamp(0, 1)


def _paint_of(strokes: Strokes, above: Tensor, size: tuple[int, int]) -> Tensor:
    """Compute each stroke's contribution (N,) to the picture per unit of its colour, summed over the canvas."""
    color = torch.zeros_like(strokes.color).requires_grad_()
    with torch.enable_grad():
        layers = Analytic()(replace(strokes, color=color, drift=torch.zeros_like(color)))
        picture = Tiled()(layers, above, size, torch.zeros(3)).image
        (slope,) = torch.autograd.grad(picture[0].sum(), color, allow_unused=True, materialize_grads=True)
    return slope[:, 0]


def sizes_set_by(saved: Saved) -> str:
    """Return the setting that determined the ``SIZE_MEASURES`` of strokes, such as ``init=slic``, or "".

    Gradient descent hardly changes the initial sizes, so sizes set this way reveal nothing about a painter's brushes.
    The result is "" for strokes that were recovered from a picture or that do not come from a run.
    """
    config = config_of(saved)
    chosen = {
        family: name_of_target(target, family)
        for family in ("painter", "init")
        if isinstance(node := config.get(family), dict) and isinstance(target := node.get("_target_"), str)
    }
    if not chosen or chosen.get("painter", "gradient") != "gradient":
        return f"painter={chosen['painter']}" if chosen else ""
    style = config.get("style")
    given = {
        "catalogue": config.get("catalogue"),
        "style.brushwork": isinstance(style, dict) and style.get("brushwork"),
    }
    return next((f"{key}={value}" for key, value in given.items() if value), f"init={chosen.get('init', 'slic')}")


def direction_shares(angle: Array, weight: Array | None = None) -> Array:
    """Bin directions (n,) in degrees; return each bin's weighted share (DIRECTION_BINS,). Bin 0 is centred on 0."""
    number = np.floor(angle * DIRECTION_BINS / 180 + 0.5).astype(np.intp) % DIRECTION_BINS
    shares = np.bincount(number, weight, DIRECTION_BINS)
    return shares / (shares.sum() or 1)
