"""The check of one cell of the matrix of extremes against float64, and the bounds that it goes by."""

from dataclasses import dataclass
from enum import Enum

import torch
from torch import Tensor

from brushexp.strokes.catalogue import FIELDS, Strokes

DTYPES = {"float64": torch.float64, "float32": torch.float32, "bfloat16": torch.bfloat16, "float16": torch.float16}
# Largest difference of a pixel, in [0, 1]. Strokes of 16 bits are drawn in float32, so their pictures are as exact.
PICTURE_BOUNDS = {"float64": 1e-9, "float32": 1e-4, "bfloat16": 1e-4, "float16": 1e-4}
# Largest relative difference of a field's gradient, see `gradient_error`; of 16 bits, what rounding it once may cost.
GRADIENT_BOUNDS = {"float64": 1e-6, "float32": 1e-3, "bfloat16": 2**-8, "float16": 2**-9}
NEGLIGIBLE_SHARE = 1e-3  # of the sum of |dL/dI| over all pixels, below which a gradient moves nothing


class Outcome(Enum):
    """What became of a scene.

    exact: picture and gradient agree with float64 within the bounds; degraded: finite, but outside of them; refused:
    with a message that a user can act on; broken: NaN, Inf, an alpha or a picture outside [0, 1], or a crash.
    """

    exact = "exact"
    degraded = "degraded"
    refused = "refused"
    broken = "broken"


@dataclass(frozen=True)
class Check:
    """An outcome and its reasons.

    Attributes:
        outcome: in a word.
        picture: largest difference of a pixel from float64; None if there is no picture.
        gradient: largest relative difference of a gradient; None if there is none.
        note: what should be known besides: a message, what is broken, how many strokes or steps it was.
        only_gradient: the picture is within its bound, a gradient is not.
    """

    outcome: Outcome
    picture: float | None = None
    gradient: float | None = None
    note: str = ""
    only_gradient: bool = False


@dataclass(frozen=True)
class DrawnScene:
    """A scene drawn forwards and backwards.

    Attributes:
        image: (3, H, W).
        gradient: of the mean squared error, field -> as the field; empty if there is none.
        pull: sum of |dL/dI| over the picture, what a gradient is large or small against.
        fault: "" or what is already known to be broken.
    """

    image: Tensor
    gradient: dict[str, Tensor]
    pull: float = 0.0
    fault: str = ""


def compare(dtype: str, drawn: DrawnScene, exact: DrawnScene, strokes: Strokes, note: str = "") -> Check:
    """Compare what was drawn of strokes that came in the precision ``dtype`` with the same in float64."""
    fault = drawn.fault or _fault_of(drawn, PICTURE_BOUNDS[dtype])
    if fault:
        return Check(Outcome.broken, note=fault)
    picture = float((drawn.image.double() - exact.image).abs().max())
    slopes = [gradient_error(g, exact.gradient[name], name, strokes, exact.pull) for name, g in drawn.gradient.items()]
    slope = max(slopes, default=None)
    seen, moved = picture > PICTURE_BOUNDS[dtype], slope is not None and slope > GRADIENT_BOUNDS[dtype]
    outcome = Outcome.degraded if seen or moved else Outcome.exact
    return Check(outcome, picture, slope, note, only_gradient=moved and not seen)


def _fault_of(drawn: DrawnScene, slack: float) -> str:
    """What is broken about a picture or its gradient; "" if nothing is."""
    image = drawn.image
    if not image.isfinite().all():
        return "the picture is not finite"
    if image.numel() and (image.min() < -slack or image.max() > 1 + slack):
        return f"the picture goes from {float(image.min()):.3g} to {float(image.max()):.3g}"
    wrong = [name for name, value in drawn.gradient.items() if not value.isfinite().all()]
    return f"the gradient of {wrong[0]} is not finite" if wrong else ""


def gradient_error(value: Tensor, exact: Tensor, name: str, strokes: Strokes, pull: float) -> float:
    """|g - g64| / (|g64| + NEGLIGIBLE_SHARE * pull), norms over all strokes.

    Gradients of points and widths, which are fractions of a window, count per pixel, so that large windows do not
    make rounding large.
    """
    if not len(value):
        return 0.0
    difference, size = value.double() - exact.double(), exact.double()
    if name in ("start", "control", "end", "width"):
        per_pixel = 0.5 * strokes.scale.double().reshape(-1, *[1] * (value.ndim - 1))
        difference, size = difference / per_pixel, size / per_pixel
    return float(difference.norm() / (size.norm() + NEGLIGIBLE_SHARE * pull + 1e-300))


def range_fault(strokes: Strokes, slack: float = 1e-6) -> str:
    """Which field of strokes is not finite or outside `FIELDS`; "" if none is."""
    for name, field in FIELDS.items():
        value = getattr(strokes, name).detach()
        if not value.isfinite().all():
            return f"{name} is not finite"
        room = slack * max(abs(field.low), abs(field.high))
        if len(value) and (value.min() < field.low - room or value.max() > field.high + room):
            return f"{name} goes from {float(value.min()):g} to {float(value.max()):g}"
    return ""
