"""Corrupt valid strokes to create negative examples for training a discriminator."""

import math
from collections.abc import Callable

import torch
from torch import Tensor
from torch.nn import functional

from brushexp.contracts.strokes import INSET, SHORTEST_CHORD, THICKEST, THINNEST, width_of, width_parameter
from brushexp_training.discriminator.discriminator import SHAPE

GROUPS = (2, 2, 2, 1)  # columns of start, control, end and width
SMALLEST_INTRUSION = 0.005  # minimum distance from the valid square, in half-windows
FARTHEST_INVALID = 3e3  # half-windows; `strokes.catalogue.FIELDS` ends at 1e3
THICKEST_INVALID = 1e3  # sides of the window, as in FIELDS


def corrupt(valid: Tensor, generator: torch.Generator) -> tuple[Tensor, Tensor, Tensor]:
    """Corrupt each of the valid strokes (n, 7) with a randomly chosen function from `CORRUPTIONS`.

    Returns the corrupted strokes (n, 7); hard negatives (n, 7), which are the same strokes with some groups of
    parameters moved halfway back to their valid values; and the indices (n,) of the chosen functions.
    """
    kind = torch.randint(len(CORRUPTIONS), (len(valid),), generator=generator)
    shapes = valid.clone()
    for number, function in enumerate(CORRUPTIONS.values()):
        chosen = kind == number
        shapes[chosen] = function(valid[chosen], generator)
    groups = _uniform(len(valid), len(GROUPS), generator) < 0.5
    groups |= _uniform(len(valid), 1, generator) < 0.5  # all groups in half of the strokes
    return shapes, torch.where(_columns(groups), 0.5 * (shapes + valid), shapes), kind


def _sample_in_box(valid: Tensor, generator: torch.Generator) -> Tensor:
    """Sample new points in a box larger than the box of valid strokes, up to 3000 half-windows from the middle.

    Half of the strokes also get a width outside the valid range, of up to 1000 window sides.
    """
    n = len(valid)
    points = (2 * _uniform(n, 6, generator) - 1) * _log_uniform(n, INSET, FARTHEST_INVALID, generator)
    width = torch.where(_uniform(n, 1, generator) < 0.5, valid[:, 6:], _thickness(n, generator))
    return torch.cat([points, width], dim=1)


def _enlarge(valid: Tensor, generator: torch.Generator) -> Tensor:
    """Enlarge a stroke until it extends up to 3000 half-windows beyond the window's border; its shape is preserved."""
    points, width = valid.split([6, 1], dim=1)
    farthest = INSET + _log_uniform(len(valid), SMALLEST_INTRUSION, FARTHEST_INVALID, generator)
    reach = farthest / points.abs().amax(1, keepdim=True)
    return torch.cat([points * reach, width], dim=1)


def _shift(valid: Tensor, generator: torch.Generator) -> Tensor:
    """Move a stroke partly or wholly out of the window; its shape is preserved."""
    n = len(valid)
    points, width = valid.split([6, 1], dim=1)
    side = torch.where(_uniform(n, 2, generator) < 0.5, -1.0, 1.0)
    room = INSET - (side * points.reshape(n, 3, 2).transpose(0, 1)).amax(0)  # (n, 2), distance to the border
    axes = _uniform(n, 2, generator) < 0.5
    axes[:, 0] |= ~axes.any(1)
    shift = axes * side * (room + _log_uniform(n, SMALLEST_INTRUSION, FARTHEST_INVALID, generator))
    return torch.cat([points + shift.repeat(1, 3), width], dim=1)


def _mix(valid: Tensor, generator: torch.Generator) -> Tensor:
    return torch.where(_one_group(len(valid), generator), valid.roll(1, 0), valid)


def _noisy(valid: Tensor, generator: torch.Generator) -> Tensor:
    """Add Gaussian noise to all parameters, with a standard deviation from 0.1 to 3000 half-windows."""
    strength = _log_uniform(len(valid), 0.1, FARTHEST_INVALID, generator)
    return valid + strength * torch.randn(valid.shape, generator=generator)


def _partly_noisy(valid: Tensor, generator: torch.Generator) -> Tensor:
    """Add the same noise as `_noisy`, but to only one group of parameters."""
    return torch.where(_one_group(len(valid), generator), _noisy(valid, generator), valid)


def _off_width(valid: Tensor, generator: torch.Generator) -> Tensor:
    """Make a stroke thinner or thicker than any valid stroke."""
    return torch.cat([valid[:, :6], _thickness(len(valid), generator)], dim=1)


def _outside(valid: Tensor, generator: torch.Generator) -> Tensor:
    """Move one coordinate of one point, often only slightly, out of the square that bounds valid strokes."""
    n = len(valid)
    where = functional.one_hot(torch.randint(6, (n,), generator=generator), SHAPE).bool()
    beyond = INSET + _log_uniform(n, SMALLEST_INTRUSION, FARTHEST_INVALID, generator)
    return torch.where(where, torch.where(valid < 0, -beyond, beyond), valid)


def _shorten(valid: Tensor, generator: torch.Generator) -> Tensor:
    """Shorten a stroke, possibly to a point, until it is too short for its thickness; its bend is preserved."""
    start, control, end, width = valid.split([2, 2, 2, 1], dim=1)
    middle, chord = 0.5 * (start + end), end - start
    length = torch.linalg.vector_norm(chord, dim=1, keepdim=True)
    thickness = width_of(width)
    shrink = _uniform(len(valid), 1, generator) * (SHORTEST_CHORD / THINNEST) * thickness / length
    return torch.cat([*(middle + shrink * (point - middle) for point in (start, control, end)), width], dim=1)


def _bend(valid: Tensor, generator: torch.Generator) -> Tensor:
    """Place the control point 0.5 to 3000 chord lengths away from the middle of the chord, in a random direction."""
    start, _, end, width = valid.split([2, 2, 2, 1], dim=1)
    length = torch.linalg.vector_norm(end - start, dim=1, keepdim=True)
    angle = 2 * math.pi * _uniform(len(valid), 1, generator)
    offset = torch.cat([angle.cos(), angle.sin()], dim=1) * _log_uniform(len(valid), 0.5, FARTHEST_INVALID, generator)
    return torch.cat([start, 0.5 * (start + end) + length * offset, end, width], dim=1)


CORRUPTIONS: dict[str, Callable[[Tensor, torch.Generator], Tensor]] = {  # in the order of the discriminator's records
    "boxed": _sample_in_box,
    "enlarged": _enlarge,
    "shifted": _shift,
    "mixed": _mix,
    "noisy": _noisy,
    "partly_noisy": _partly_noisy,
    "off_width": _off_width,
    "outside": _outside,
    "shortened": _shorten,
    "bent": _bend,
}


def _uniform(n: int, columns: int, generator: torch.Generator) -> Tensor:
    return torch.rand(n, columns, generator=generator)


def _log_uniform(n: int, low: float, high: float, generator: torch.Generator) -> Tensor:
    """Sample values (n, 1) from a log-uniform distribution."""
    return low * (high / low) ** _uniform(n, 1, generator)


def _thickness(n: int, generator: torch.Generator) -> Tensor:
    """Sample widths (n, 1) outside `WIDTH`, in the encoding of `strokes.prior.parameters_of`."""
    thin, thick = THINNEST * _uniform(n, 1, generator), _log_uniform(n, THICKEST, THICKEST_INVALID, generator)
    width = torch.where(_uniform(n, 1, generator) < 0.5, thin, thick)
    return width_parameter(width)


def _one_group(n: int, generator: torch.Generator) -> Tensor:
    """Sample masks (n, 7), each of which selects one of the `GROUPS`."""
    return _columns(functional.one_hot(torch.randint(len(GROUPS), (n,), generator=generator), len(GROUPS)).bool())


def _columns(groups: Tensor) -> Tensor:
    return groups.repeat_interleave(torch.tensor(GROUPS), dim=1)
