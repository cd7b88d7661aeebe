"""Define a painter's hand: a set of parameters that determines how strokes are placed."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

Random = np.random.Generator

TRACE_STEPS = 12  # number of steps from the middle of a stroke to each end
TURN = 0.12  # maximum turn of a stroke per step in radians


class Layer(NamedTuple):
    """A group of strokes with similar widths."""

    share: float  # share of all strokes
    width: float  # width relative to the broadest layer


@dataclass(frozen=True)
class Hand:
    """A painter's hand; by default, strokes fill a picture in three layers, from broad to fine."""

    layers: tuple[Layer, ...] = (Layer(0.20, 1.0), Layer(0.35, 0.62), Layer(0.45, 0.40))
    cover: float = 2.3  # nominal total area of all strokes, in canvases
    aspect: tuple[float, float] = (6.5, 0.3)  # length in widths: median and spread of the logarithm
    limits: tuple[float, float] = (3.5, 11.0)  # range of the length in widths
    uneven: float = 0.15  # spread of the logarithm of widths within a layer
    directions: int = 16  # number of directions of strokes
    shaky: float = 4.0  # spread of directions in degrees
    color: float = 1.0  # strength of colour differences between strokes; 1 is 5, 3.5, 3.5 in CIELAB
    palette: int = 0  # number of paints; 0 = one per stroke
    hatch: float = 0.0  # share of the picture hatched in patches of one direction instead of along edges
    turn: float = TURN  # maximum bend of a stroke in each of `TRACE_STEPS` steps, in radians
    sway: float = 0.0  # spread of S-bends in widths
    taper: float = 0.0  # spread of the relative change of width from end to end
    even: bool = False  # whether places lie on a jittered grid instead of more densely at detail
    clip: float = 0.0  # colour difference in sRGB at which a stroke ends early; 0 = never
    row: int = 1  # number of strokes side by side in similar colours; 1 = no rows
