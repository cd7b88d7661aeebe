"""Draw contours in a picture: bold single lines, outlines as chains of strokes, and fine features."""

import math

import numpy as np
import torch

from brushexp.contracts.pictures import along_edges, sample_at, sharpness, structure_tensor, worst_of_cells
from brushexp.contracts.strokes import Strokes
from brushexp_media.init.ink import strokes_of
from brushexp_media.picture.lines import (
    BESIDE,
    SIGMA,
    anisotropy_of,
    edge_lines,
    find_apart,
    follow_flow,
    points_of,
)
from brushexp_media.picture.outlines import SPACING, find_outlines, strokes_over

Array = np.ndarray
FLOW_BLUR, STRAIGHT_BLUR = 0.004, 0.008  # blur of the flow and of the straightness of edges, in longer sides
LOOKED_AT = 0.3  # share of the largest focus above which a pixel is in the area of attention
CRISP = 0.3  # sharpness of an edge that gets a full contour, relative to the sharpest
FRAME = 0.018  # longer sides from the edge of the picture within which lines are no contours
FAINTEST = 0.12  # strength below which no line is drawn
FEATURES = 0.35  # share of contours that are fine lines in areas of attention
BOLD = 0.75  # share of the other contours that are single strokes, where edges are strong and straight
SHADED = 0.6  # weakening of outlines in areas of attention, so that shading around eyes gets none
LIGHTEST = 0.35  # width of the faintest lines relative to the strongest
OUTLINE_LENGTH = 0.5  # length of the strokes of an outline, relative to that of single lines
FADING = 1.5  # exponent of the focus by which faint features fade
FINER = 0.55  # size of fine contours relative to the others
LARGE, SLIGHTEST = 0.3, 0.35  # radius of a part with lines of full size, in longer sides; least relative size
SUBTLE = 0.004  # least difference of fine features, relative to the lightness around them
SHORTEST_LINE = 0.3  # share of the full length below which a contour is dropped
MORE, APART = 3, 0.7  # lines traced per line drawn; least distance between two of them in widths
TINY = 1e-9  # variation below which focus or sharpness counts as uniform
SCALES = ((2.0, 1.0, 0.8 * FAINTEST), (1.0, FINER, 1.6 * FAINTEST))  # scale, relative width, strength of outlines
THINNEST_LOOP, HOOKED = 8.0, 0.6  # thinnest shape with an outline in line widths; chord of such outlines over length
NONE_DRAWN = np.zeros((0, 3, 2))
FINEST = 0.7  # least scale of outlines in pixels


def contours(
    picture: Array, grey: Array, n: int, length: float, width: float, color: Array, focus: Array | None = None
) -> Strokes:
    """Draw n contour strokes for a picture (3, H, W): single bold lines, outlines, and fine lines in the focus.

    Single lines follow strong straight edges. Outlines, drawn as chains of strokes, follow the other edges of the
    greyscale picture ``grey`` (H, W), the longest and strongest first. ``length`` and ``width`` are the maximum
    dimensions of a stroke in pixels. With a ``focus`` (H, W), some of the strokes draw faint features in it, such as
    eyes and mouths. Blurred edges get no contour.
    """
    side = max(picture.shape)
    frame = round(FRAME * side)
    inner = np.pad(np.ones(np.array(picture.shape[1:]) - 2 * frame), frame) if min(picture.shape[1:]) > 2 * frame else 0
    sharp = sharpness(torch.from_numpy(picture)).numpy()
    crisp = (sharp / max(CRISP * float(sharp.max()), TINY)).clip(0, 1)
    straight = anisotropy_of(structure_tensor(picture, max(1.0, STRAIGHT_BLUR * side)))
    clear, looked_at = inner * crisp, np.zeros(picture.shape[1:]) if focus is None else focus / focus.max()
    few = 0 if focus is None else round(FEATURES * n)
    bold = round(BOLD * (n - few))
    flow = along_edges(structure_tensor(picture, max(1.0, FLOW_BLUR * side)))
    coarse = np.maximum(edge_lines(picture), 0.8 * edge_lines(picture, 2.0)) * clear
    attended = looked_at > LOOKED_AT
    size = _relative_size(attended)
    single = _trace(coarse, flow, straight, bold, size, length, width)
    clear = clear * straight * (1 - SHADED * looked_at)
    parts = [single, _draw_outlines(grey, clear, single[0], n - few - bold, length, width)]
    if few:
        faint = _fine_lines(picture, SUBTLE) * inner * attended * looked_at**FADING
        finer = FINER * length, FINER * width
        parts.append(_trace(faint, flow, straight, few, size, *finer, float(attended.sum()), single[0]))
    curve, across = (np.concatenate(part) for part in zip(*parts, strict=True))
    return strokes_of(curve, across, across > 0, color, n)


def _draw_outlines(grey: Array, clear: Array, drawn: Array, n: int, length: float, width: float) -> tuple[Array, Array]:
    """Trace the outlines in a picture (H, W), coarse ones first; return at most n curves (m, 3, 2) and widths (m,).

    Outlines are omitted beside curves already ``drawn`` (k, 3, 2), and where edges are not ``clear`` (H, W).
    """
    side, near = max(grey.shape), max(1, round(APART * width))
    taken, curves, widths, count = np.zeros(grey.shape, bool), [NONE_DRAWN], [np.zeros(0)], 0
    _take(taken, points_of(drawn).reshape(-1, 2), near)
    for scale, broad, lowest in SCALES:
        lines = find_outlines(grey, max(FINEST, scale * SIGMA * side), clear, lowest, 2 * lowest)
        lines.sort(key=lambda line: -float(line[1].sum()))
        for points, strength in lines:
            if count >= n:
                break
            x, y = points.astype(int).T
            if taken[y, x].mean() > BESIDE or len(points) * SPACING < SHORTEST_LINE * length:
                continue
            if _is_loop(points, THINNEST_LOOP * width):
                continue
            curve, middle = strokes_over(points, OUTLINE_LENGTH * length)
            curves.append(curve)
            widths.append(broad * width * _relative_width(strength[middle]))
            _take(taken, points, near)
            count += len(curve)
    return np.concatenate(curves)[:n], np.concatenate(widths)[:n]


def _is_loop(points: Array, thinnest: float) -> bool:
    """Check whether an outline (k, 2) runs around a shape thinner than ``thinnest`` pixels, such as a lock of hair."""
    length = len(points) * SPACING
    x, y = (points - points[0]).T
    area = 0.5 * abs(float(x[:-1] @ y[1:] - x[1:] @ y[:-1]))
    return bool(np.hypot(x[-1], y[-1]) < HOOKED * length and 2 * area < thinnest * length)


def _relative_width(strength: Array) -> Array:
    """Compute the width of lines from their strength, 0 to 1, relative to the width of the strongest line."""
    return LIGHTEST + (1 - LIGHTEST) * strength


def _take(taken: Array, points: Array, near: int) -> None:
    """Mark the pixels of a map (H, W) that are at most ``near`` pixels from points (n, 2: x, y) along each axis."""
    for column, row in points.astype(int).tolist():
        taken[max(row - near, 0) : row + near + 1, max(column - near, 0) : column + near + 1] = True


def _relative_size(attended: Array) -> Array:
    """Compute the relative size (H, W) of lines, which is below 1 in small parts of the area of attention (H, W)."""
    from scipy.ndimage import label  # noqa: PLC0415  (slow to import)

    part, _ = label(attended)
    radius = np.sqrt(np.bincount(part.reshape(-1)) / math.pi)
    radius[0] = math.inf  # elsewhere
    return (radius / (LARGE * max(attended.shape))).clip(SLIGHTEST, 1)[part]


def _fine_lines(picture: Array, least: float) -> Array:
    """Find lines (H, W) in a picture (3, H, W) that are no thicker than a pen line."""
    return np.maximum(*(edge_lines(picture, scale, least) for scale in (FINER, 1.0)))


def _trace(
    lines: Array,
    flow: Array,
    straight: Array,
    n: int,
    size: Array,
    length: float,
    width: float,
    area: float | None = None,
    drawn: Array = NONE_DRAWN,
) -> tuple[Array, Array]:
    """Trace at most n lines in a strength map (H, W) along a flow (H, W); return curves (m, 3, 2) and widths (m,).

    Lines where ``straight`` (H, W) is high are traced first. At most one line starts in each cell of a grid, whose cell
    size follows from n and the ``area`` in pixels (None: the whole map). Lines are at most ``length`` long and
    ``width`` wide, times the relative ``size`` (H, W), and do not run along curves already ``drawn`` (k, 3, 2).
    """
    _, x, y = worst_of_cells(lines, max(2, round(0.6 * math.sqrt((area or lines.size) / max(n, 1)))))
    strength = sample_at(lines, x, y)
    best = np.argsort(-strength * sample_at(straight, x, y), kind="stable")[: MORE * n]
    places, strength = np.stack([x, y], 1)[best] + 0.5, strength[best]
    here = sample_at(size, *places.T)
    pressed = here * _relative_width(strength)
    curve = follow_flow(places, flow, 0.5 * length * pressed, lines, FAINTEST)
    seen = (strength > FAINTEST) & (np.linalg.norm(curve[:, 2] - curve[:, 0], axis=1) > SHORTEST_LINE * length * here)
    apart = find_apart(np.concatenate([drawn, curve[seen]]), lines.shape, APART * width) - len(drawn)
    kept = apart[apart >= 0][:n]
    return curve[seen][kept], (width * pressed)[seen][kept]
