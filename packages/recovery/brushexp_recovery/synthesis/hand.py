"""How a painter lays strokes."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

Random = np.random.Generator

TRACE_STEPS = 12  # from the middle of a stroke to either end
TURN = 0.12  # radians by which a stroke turns in a step at most


class Layer(NamedTuple):
    """Strokes of about one width."""

    share: float  # of all strokes
    width: float  # times that of the broadest layer


@dataclass(frozen=True)
class Hand:
    """How a painter lays strokes; the defaults are of one who fills a picture in three layers, broad to fine."""

    layers: tuple[Layer, ...] = (Layer(0.20, 1.0), Layer(0.35, 0.62), Layer(0.45, 0.40))
    cover: float = 2.3  # nominal areas of all strokes together, in canvases
    aspect: tuple[float, float] = (6.5, 0.3)  # length in widths: median, and spread of its logarithm
    limits: tuple[float, float] = (3.5, 11.0)  # of the length in widths
    uneven: float = 0.15  # spread of the logarithm of widths in a layer
    directions: int = 16  # in which strokes are laid
    shaky: float = 4.0  # degrees: spread of their directions
    color: float = 1.0  # strength with which colours differ between strokes: 1 is 5, 3.5, 3.5 in CIELAB
    palette: int = 0  # number of paints; 0: as many as there are strokes
    hatch: float = 0.0  # share of the picture that is hatched in one direction a place, not along the edges
    turn: float = TURN  # radians by which a stroke may bend in each of `TRACE_STEPS` steps
    sway: float = 0.0  # of S-bends, spread, in widths
    taper: float = 0.0  # spread of the change of width from end to end, as a share
    even: bool = False  # places on a grid, slightly moved, not more of them where there is detail
    clip: float = 0.0  # difference of colour, sRGB, at which a stroke ends before its time; 0: never
    row: int = 1  # strokes side by side, of about one colour; 1: each for itself
