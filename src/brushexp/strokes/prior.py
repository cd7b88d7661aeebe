"""Sample valid strokes (thesis 2020, eq. 6.1 to 6.5), and convert strokes to parameters and back."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from brushexp.strokes.bezier import curve_of
from brushexp.strokes.catalogue import Strokes

WINDOW = 64.0  # side, in pixels, of the window of a simulated stroke
THINNEST, THICKEST = 0.03, 0.2  # widths of valid strokes, in sides of the window
INSET = 0.7  # factor that shrinks strokes towards the window's centre, so that its edge does not clip them
SPREAD = (1 / 200, 1 / 25)  # variance of the control point along and across s - e, in units of |s - e|
TOUCHING = 1e-6  # half-windows or pixels; ends closer than this have no direction between them
SHORTEST_CHORD = 4 * THINNEST * INSET  # distance between start and end of the shortest valid stroke, in half-windows

Array = NDArray[np.float64]
Value = TypeVar("Value", float, Tensor)


def sample_prior(n: int, seed: int = 0, first: int = 0) -> Strokes:
    """Draw the valid strokes numbered ``first`` to ``first + n - 1``; each depends only on ``seed`` and its number.

    Start s and end e are uniform in the window and thickness w in [``THINNEST``, ``THICKEST``]; they are redrawn until
    |s - e| >= 2 w (in sides of the window). The control point is normal about the midpoint, with variances ``SPREAD``,
    and is redrawn until it lies in the window. All three points are then scaled by ``INSET``. The strokes are float32
    on the CPU, opaque, at position 0, with uniform colours. In eq. 6.1 of the source, the inequality is reversed.
    """
    draw = partial(_uniform, seed, first, n)
    body = _redraw(lambda attempt: draw(2 * attempt, 8), _long_enough)  # (n, 8): start 2, end 2, width, colour 3
    start, end = 2 * body[:, :2] - 1, 2 * body[:, 2:4] - 1  # half-windows
    bent = partial(_control_points, start, end)
    control = _redraw(lambda attempt: bent(draw(2 * attempt + 1, 4)), lambda points: np.abs(points).max(axis=1) <= 1)
    parts = (INSET * start, INSET * control, INSET * end, 2 * body[:, 4:] - 1)
    return strokes_of(torch.from_numpy(np.concatenate(parts, axis=1)).float())


def width_of(parameter: Tensor) -> Tensor:
    """Convert width parameters, which lie in [-1, 1] for valid strokes, to widths as fractions of the window's side."""
    return THINNEST + (THICKEST - THINNEST) * 0.5 * (parameter + 1)


def width_parameter(width: Value) -> Value:
    """Convert a width to its parameter; the inverse of `width_of`."""
    return (2 * width - (THICKEST + THINNEST)) / (THICKEST - THINNEST)


def parameters_of(strokes: Strokes) -> Tensor:
    """Convert strokes to window parameters (N, 10), in [-1, 1] if valid: start, control, end, width, colour."""
    width = width_parameter(strokes.width[:, None])
    return torch.cat([strokes.start, strokes.control, strokes.end, width, 2 * strokes.color - 1], dim=1)


def strokes_of(parameters: Tensor) -> Strokes:
    """Invert `parameters_of`: convert parameters (N, 10) to opaque strokes at position 0 in windows of 64 pixels."""
    start, control, end, width, color = parameters.split([2, 2, 2, 1, 3], dim=1)
    one = torch.ones_like(width[:, 0])
    where = torch.zeros_like(start), WINDOW * one, start, control, end
    return Strokes(*where, width_of(width[:, 0]), 0.5 * (color + 1), one)


def clamp_to_prior(strokes: Strokes) -> Strokes:
    """Clamp points and widths to the range of `sample_prior`; clamped values get no gradient.

    Points are clamped to +-``INSET`` half-windows and widths to [``THINNEST``, ``THICKEST``]. Chords are lengthened to
    at least ``SHORTEST_CHORD``. As in eq. 6.1 of the source, the thickness is at most half the length of the chord
    before the inset, but at least ``THINNEST``.
    """
    start, control, end = (value.clamp(-INSET, INSET) for value in (strokes.start, strokes.control, strokes.end))
    along, length = _along((end - start).detach())
    way = 0.5 * (SHORTEST_CHORD - length).clamp_min(0)[:, None] * along
    start, end = start - way, end + way
    length = 0.5 * torch.linalg.vector_norm(start - end, dim=1) / INSET  # sides of the window, before the inset
    width = torch.minimum(strokes.width, 0.5 * length).clamp(THINNEST, THICKEST)
    return replace(strokes, start=start, control=control, end=end, width=width)


def _along(chord: Tensor) -> tuple[Tensor, Tensor]:
    """Compute the directions (N, 2) and lengths (N,) of chords (N, 2); a chord of length 0 points right."""
    length = torch.linalg.vector_norm(chord, dim=1)
    right = torch.tensor([1.0, 0.0]).to(chord)
    return torch.where((length > TOUCHING)[:, None], chord / length.clamp_min(TOUCHING)[:, None], right), length


@torch.no_grad()
def rewindow(strokes: Strokes) -> Strokes:
    """Choose windows so that `clamp_to_prior` changes strokes as little as possible; valid strokes keep theirs.

    Each window is centred on the control points, and its side is the valid side nearest to the old one. Two kinds of
    stroke fit no window and change at constant area: strokes too short for their thickness become longer and thinner,
    and strokes too thin for their length become thicker and shorter. In a painting of 655 strokes, a quarter of which
    were of these two kinds, this change cost 1.3 dB; merely thinning the short strokes cost 3.5 dB.
    """
    curve, thickness = _long_as_wide(curve_of(strokes), strokes.width * strokes.scale)
    low, high = curve.amin(1), curve.amax(1)
    centre, extent = 0.5 * (low + high), (high - low).amax(1)
    smallest = torch.maximum(extent / INSET, thickness / THICKEST).clamp_min(1e-3)
    largest = (thickness / THINNEST).clamp_min(1)  # a window smaller than a pixel shows nothing
    scale = torch.maximum(torch.minimum(strokes.scale, largest), smallest)
    scale = torch.where(smallest > largest, (smallest * largest).sqrt(), scale)
    shrink = (scale / smallest).clamp_max(1)
    points = (curve - centre[:, None]) * (2 * shrink / scale)[:, None, None]
    start, control, end = points.clamp(-INSET, INSET).unbind(1)  # clamps only rounding errors
    width = (thickness / scale).clamp_min(THINNEST)
    new = replace(strokes, position=centre, scale=scale, start=start, control=control, end=end, width=width)
    valid = (parameters_of(strokes) == parameters_of(clamp_to_prior(strokes))).all(1)
    fields = {
        name: torch.where(valid[:, None] if value.ndim > 1 else valid, value, getattr(new, name))
        for name, value in strokes.items()
    }
    return replace(strokes, **fields)


def bend_of(strokes: Strokes) -> Tensor:
    """Compute the `control_offset` (N, 2) of strokes; shorter chords count as ``SHORTEST_CHORD`` long."""
    return control_offset(torch.stack([strokes.start, strokes.control, strokes.end], dim=1), SHORTEST_CHORD)


def control_offset(curve: Tensor, shortest: float) -> Tensor:
    """Measure control points (N, 2) from the chord's midpoint, along and across s - e, in units of |s - e|.

    The dot products with s - e and its normal are divided by max(|s - e|, ``shortest``)^2.
    """
    start, control, end = curve.unbind(1)
    chord, offset = start - end, control - 0.5 * (start + end)
    across = torch.stack([-chord[:, 1], chord[:, 0]], dim=1)
    square = chord.square().sum(1, keepdim=True).clamp_min(shortest**2)
    return torch.stack([(offset * chord).sum(1), (offset * across).sum(1)], dim=1) / square


def _long_as_wide(curve: Tensor, thickness: Tensor) -> tuple[Tensor, Tensor]:
    """Lengthen and thin curves (N, 3, 2) with chords under 2 ``INSET`` thicknesses (N,), at constant area."""
    start, control, end = curve.unbind(1)
    along, length = _along(end - start)
    least = 2 * INSET * (1 + 1e-5)  # slightly above the limit, so that rounding does not make it invalid
    thinner = ((length * thickness + 0.25 * np.pi * thickness.square()) / (least + 0.25 * np.pi)).sqrt()
    short = length < 2 * INSET * thickness
    middle, half = 0.5 * (start + end), 0.5 * (least * thinner)[:, None] * along
    longer = torch.stack([middle - half, control, middle + half], dim=1)
    return torch.where(short[:, None, None], longer, curve), torch.where(short, thinner, thickness)


def _uniform(seed: int, first: int, n: int, stream: int, columns: int) -> Array:
    """Draw numbers (n, columns) from the open interval (0, 1); row i depends only on seed, stream and first + i.

    ``columns`` must be a multiple of 4, because Philox (Salmon et al., 2011) generates four words per counter step.
    """
    source = np.random.Philox(key=np.array([seed, stream], dtype=np.uint64)).advance(first * columns // 4)
    words = source.random_raw(n * columns).reshape(n, columns)
    return ((words >> np.uint64(12)).astype(np.float64) + 0.5) * 2.0**-52


def _redraw(draw: Callable[[int], Array], valid: Callable[[Array], NDArray[np.bool_]]) -> Array:
    """Replace invalid rows of ``draw(0)`` with rows of ``draw(1)``, ``draw(2)`` and so on until all are valid."""
    rows, attempt = draw(0), 0
    while (wrong := ~valid(rows)).any():
        attempt += 1
        rows[wrong] = draw(attempt)[wrong]
    return rows


def _long_enough(body: Array) -> NDArray[np.bool_]:
    length = np.linalg.norm(body[:, :2] - body[:, 2:4], axis=1)
    return length >= 2 * (THINNEST + (THICKEST - THINNEST) * body[:, 4])


def _control_points(start: Array, end: Array, uniform: Array) -> Array:
    """Turn the first two columns of uniform numbers (n, 4) into normal control points (n, 2) (Box and Muller, 1958)."""
    radius, angle = np.sqrt(-2 * np.log(uniform[:, 0])), 2 * np.pi * uniform[:, 1]
    along = np.sqrt(SPREAD[0]) * radius * np.cos(angle)
    across = np.sqrt(SPREAD[1]) * radius * np.sin(angle)
    chord = start - end
    side = np.stack([-chord[:, 1], chord[:, 0]], axis=1)
    return 0.5 * (start + end) + along[:, None] * chord + across[:, None] * side
