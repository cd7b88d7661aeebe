"""Simulate a dry brush as soft dabs scattered around the curve."""

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
    """Dry brush of libmypaint, as used by SPIRAL (2018) and Neural Painters (2019): scattered, grainy soft dabs.

    Dabs are placed along the curve at equal steps, each displaced and resized at random. The defaults are the settings
    of libmypaint's brush ``classic/dry_brush`` (Renold), and the pressure p has the same effects as in libmypaint. The
    opacity of a dab is (opaque + opaque_by_pressure p) p. The dab is displaced by offset_by_random p radii times a
    normal random number, in x and in y. Its radius is multiplied by exp(radius_by_random times a normal random number);
    enlarged dabs are less opaque in proportion to their area. As in Neural Painters, the pressure rises over the head
    of the stroke and falls over its tail.

    The basic radius is chosen so that, at the pressure in the middle of the stroke, the expected alpha falls to half
    its maximum at half the stroke's thickness from the axis; single dabs can be farther away. Alpha is also the height.
    Coordinates are clamped to 4 half-windows from the centre.

    Unlike in libmypaint, speed has no effect (neither slow tracking nor smaller dabs where the hand is fast), dabs are
    evenly spaced from start to end, a stroke has one colour, arithmetic is exact, and a finer canvas replaces
    antialiasing.

    Args:
        window: side of a picture in pixels, 8 to 512.
        supersample: number of canvas pixels per picture pixel in each direction, 1 to 8.
        dabs_per_radius: number of dabs along a length of one radius. The default is the sum of libmypaint's dabs per
            basic radius and per actual radius, 6 and 6, because the two radii are equal here.
        hardness: hardness of a dab's profile, from 0 (a needle) to 1 (a disc).
        opaque: constant term of the opacity, before multiplication by the pressure, 0 to 1.
        opaque_by_pressure: opacity that full pressure adds, 0 to 1.
        opaque_linearize: reduction of the opacity of single dabs, from 0 (none) to 1 (overlapping dabs reach the
            specified opacity together). This brush uses 0; libmypaint's default, 0.9, would make its strokes a faint
            mist.
        offset_by_random: displacement of dabs at full pressure, in radii.
        radius_by_random: standard deviation of the logarithm of the radius.
        pressure: pressure in the middle of a stroke, above 0 to 1.
        end_pressure: pressure at both ends of a stroke, 0 to 1; equal to ``pressure`` for a constant pressure.
        head: fraction of the length over which the pressure rises.
        tail: fraction of the length after which the pressure falls.
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
    """Find the distance from a long stroke's axis, in radii, at which the expected alpha is half its value on the axis.

    At distance y, the expected alpha is 1 - exp(-s(y)). Here s is the summed opacity of all dabs along the axis: the
    integral of a dab's profile along the axis, averaged over displacements with standard deviation ``offset``.
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
    """Return the values and probabilities of a sum of four uniform numbers, scaled to mean 0 and variance 1."""
    x = np.linspace(-2, 2, GRID)
    far = np.abs(x)
    density = np.where(far < 1, 4 - 6 * far**2 + 3 * far**3, (2 - far) ** 3)
    return x * np.sqrt(3), density / density.sum()
