"""A dry brush: soft dabs, scattered about the curve."""

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from brushexp.contracts import UserError, between, register
from brushexp.contracts.families import Engine, Simulated
from brushexp.contracts.machine import share
from brushexp.contracts.strokes import strokes_of
from brushexp_dabs._stamps import curves_of, dabs, one_colour, opacity_of

SMALLEST_RADIUS = 0.2 / 64  # least basic radius, windows: libmypaint's 0.2 pixels in a window of 64
HARDNESS_MARGIN = 1e-4  # hardness 0 and 1 are drawn as this far from them
GRID = 401  # places at which the profile of a band is computed


@register("engine", "dabs")
class Dabs(Engine):
    """Dry brush of libmypaint, the stroke of SPIRAL (2018) and Neural Painters (2019): grains of scattered soft dabs.

    Dabs follow each other along the curve at equal steps, each displaced and resized at random. Their settings are
    those of libmypaint's brush ``classic/dry_brush`` (Renold), and pressure p acts as there: the opacity of a dab is
    (opaque + opaque_by_pressure p) p, it is displaced by offset_by_random p radii times a normal number in x and in y,
    its radius is multiplied by exp(radius_by_random times a normal number), and if it is larger it is as much paler.
    Pressure is as in Neural Painters: it rises over the head of the stroke and sinks over its tail.

    The basic radius follows from the thickness of the stroke: where the pressure is that of the middle, the expected
    alpha has half its height at half the thickness to either side; single dabs lie farther out. Alpha is also the
    height. Points farther than 4 half-windows from the centre are brought there.

    Differs from the source: no speed (neither slow tracking nor smaller dabs where the hand is fast); dabs are evenly
    spaced from start to end; one colour, exact arithmetic, and a finer canvas instead of libmypaint's antialiasing.

    Args:
        window: pixels on the side of a picture, 8 to 512.
        supersample: pixels of the canvas per pixel of the picture, in each direction, 1 to 8.
        dabs_per_radius: on a way of one radius; libmypaint's dabs per basic and per actual radius, 6 and 6, together,
            because here the two radii are the same.
        hardness: 0 (a needle) to 1 (a disc), of a dab's profile.
        opaque: opacity at no pressure, before it is multiplied by the pressure, 0 to 1.
        opaque_by_pressure: opacity that full pressure adds, 0 to 1.
        opaque_linearize: 0: as it is; 1: make dabs paler, so that those over one point together have the opacity. The
            brush has 0; libmypaint's default for other brushes, 0.9, makes its strokes a faint mist.
        offset_by_random: radii, at full pressure.
        radius_by_random: spread of the logarithm of the radius.
        pressure: pressure in the middle of a stroke, above 0 to 1.
        end_pressure: at its start and end, 0 to 1; give both the same number for a constant pressure.
        head: share of the length over which the pressure rises.
        tail: share of the length from which on it sinks.
    """

    def __init__(
        self,
        *,
        window: Annotated[int, between(8, 512)] = 64,
        supersample: Annotated[int, between(1, 8)] = 2,
        dabs_per_radius: Annotated[float, between(0.5, 100)] = 12.0,
        hardness: Annotated[float, between(0, 1)] = 0.2,
        opaque: Annotated[float, between(0, 1)] = 0.8,
        opaque_by_pressure: Annotated[float, between(0, 1)] = 0.2,
        opaque_linearize: Annotated[float, between(0, 1)] = 0.0,
        offset_by_random: Annotated[float, between(0, 10)] = 1.4,
        radius_by_random: Annotated[float, between(0, 1)] = 0.1,
        pressure: Annotated[float, between(0.01, 1)] = 0.8,
        end_pressure: Annotated[float, between(0, 1)] = 0.4,
        head: Annotated[float, between(0, 1)] = 0.25,
        tail: Annotated[float, between(0, 1)] = 0.75,
    ) -> None:
        if head > tail:
            raise UserError(f"engine.head={head:g} is more than engine.tail={tail:g}; try engine.head={tail:g}")
        self.window, self.supersample, self.dabs_per_radius = window, supersample, float(dabs_per_radius)
        hard = min(max(hardness, HARDNESS_MARGIN), 1 - HARDNESS_MARGIN)
        look = (hard, opaque, opaque_by_pressure, opaque_linearize, offset_by_random, radius_by_random)
        self.look, self.pressure = tuple(map(float, look)), tuple(map(float, (pressure, end_pressure, head, tail)))
        opacity = opacity_of(pressure, opaque, opaque_by_pressure, opaque_linearize, self.dabs_per_radius)
        self.half_width = half_width(hard, opacity, self.dabs_per_radius, pressure * offset_by_random)

    def __call__(self, parameters: Tensor, *, seed: int, first: int = 0) -> Simulated:
        strokes = strokes_of(parameters.detach().cpu().float())
        side = self.supersample * self.window
        curve, width = curves_of(strokes, side)
        radius = np.maximum(0.5 * width / self.half_width, SMALLEST_RADIUS * side)
        number = np.uint64(first) + np.arange(len(curve), dtype=np.uint64)
        alpha = np.empty((len(curve), self.window, self.window), np.float32)
        settings = (self.dabs_per_radius, self.look, self.pressure, np.uint64(seed))
        share(dabs, len(curve), curve, radius, *settings, number, self.supersample, alpha)
        return one_colour(strokes, alpha)


def half_width(hardness: float, opacity: float, per_radius: float, offset: float) -> float:
    """Distance from the axis of a long straight band, in radii, at which its expected alpha is half of the axis's.

    At distance y the expected alpha is 1 - exp(-s(y)): s is the opacity that the dabs of the whole axis add up to
    there, which is the integral of a dab's profile along the axis, averaged over its displacement of spread ``offset``.
    """
    across = np.linspace(-1, 1, GRID)
    square = across[:, None] ** 2 + across**2
    inner, outer = 1 - square * (1 / hardness - 1), hardness / (1 - hardness) * (1 - square)
    along = np.where(square <= hardness, inner, np.maximum(outer, 0)).sum(1) * (across[1] - across[0])
    draws, weights = _sum_of_four()
    y = np.linspace(0, 1 + offset * draws[-1], GRID)
    places = y[:, None] - offset * draws
    depth = per_radius * max(opacity, HARDNESS_MARGIN) * (np.interp(places, across, along, left=0, right=0) @ weights)
    alpha = -np.expm1(-depth)
    return float(y[alpha >= 0.5 * alpha[0]].max())


def _sum_of_four() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Values of a sum of four uniform numbers, scaled to mean 0 and variance 1, and how probable they are."""
    x = np.linspace(-2, 2, GRID)
    far = np.abs(x)
    density = np.where(far < 1, 4 - 6 * far**2 + 3 * far**3, (2 - far) ** 3)
    return x * np.sqrt(3), density / density.sum()
