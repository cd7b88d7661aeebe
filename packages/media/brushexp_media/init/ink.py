"""Make ink strokes along given curves, in a given colour."""

import numpy as np
import torch
from torch import Tensor

from brushexp.contracts import Rule, UserError
from brushexp.contracts.pictures import named_color
from brushexp.contracts.strokes import Strokes, strokes_along

Array = np.ndarray
INKED = 0.5  # strength above which lines are filled at their own thickness, as with a reed pen


def bytes_of(color: str, option: str) -> bytes:
    """Convert a colour name or '#rrggbb' to bytes; raise a UserError for other words, also ``mean``."""
    rgb = named_color(color, option)
    if rgb is None:
        raise UserError(f"{option}={color} is not the colour of an ink; try {option}=sienna")
    return rgb


INK = Rule(bytes_of)


def rgb_of(color: str) -> Array:
    """Convert a colour name or '#rrggbb' to RGB (3,), 0 to 1."""
    return np.frombuffer(bytes_of(color, "color"), np.uint8) / 255


def strokes_of(curve: Array, width: Array, seen: Array, color: Array, n: int) -> Strokes:
    """Make n strokes along curves, in one colour or one per curve; too few curves are padded with invisible strokes."""
    lacking, color = n - len(curve), np.broadcast_to(color, (len(curve), 3))
    curve, width, seen, color = (
        np.concatenate([part, np.full((lacking, *part.shape[1:]), fill, part.dtype)])
        for part, fill in ((curve, 0), (width, 1), (seen, False), (color, 0))
    )
    paint = torch.from_numpy(color)
    opacity = torch.from_numpy(seen).double()
    return strokes_along(torch.from_numpy(curve), torch.from_numpy(width), paint, opacity).map(Tensor.float)
