"""The verdict on one cell of the matrix of extremes, and the bounds that it goes by."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

import torch
from torch import Tensor

from brushexp.strokes.catalogue import FIELDS, Strokes

DTYPES = {"float64": torch.float64, "float32": torch.float32, "bfloat16": torch.bfloat16, "float16": torch.float16}
# Largest difference of a pixel, in [0, 1]. Strokes of 16 bits are drawn in float32, so their pictures are as exact.
PICTURE = {"float64": 1e-9, "float32": 1e-4, "bfloat16": 1e-4, "float16": 1e-4}
# Largest relative difference of a field's gradient, see `gradient_error`; of 16 bits, what rounding it once may cost.
GRADIENT = {"float64": 1e-6, "float32": 1e-3, "bfloat16": 2**-8, "float16": 2**-9}
NEGLIGIBLE = 1e-3  # share of the sum of |dL/dI| over all pixels, below which a gradient moves nothing


class Verdict(Enum):
    """What became of a scene.

    exact: picture and gradient agree with float64 within the bounds; degraded: finite, but outside of them; refused:
    with a message that a user can act on; broken: NaN, Inf, an alpha or a picture outside [0, 1], or a crash.
    """

    exact = "exact"
    degraded = "degraded"
    refused = "refused"
    broken = "broken"


@dataclass(frozen=True)
class Judgement:
    """A verdict and its reasons.

    Attributes:
        verdict: in a word.
        picture: largest difference of a pixel from float64; None if there is no picture.
        gradient: largest relative difference of a gradient; None if there is none.
        note: what should be known besides: a message, what is broken, how many strokes or steps it was.
        only_gradient: the picture is within its bound, a gradient is not.
    """

    verdict: Verdict
    picture: float | None = None
    gradient: float | None = None
    note: str = ""
    only_gradient: bool = False


def judge(
    dtype: str,
    image: Tensor,
    exact: Tensor,
    gradient: Mapping[str, Tensor],
    exact_gradient: Mapping[str, Tensor],
    *,
    strokes: Strokes,
    pull: float,
    faults: str = "",
    note: str = "",
) -> Judgement:
    """Compare a picture (3, H, W) and the gradients of strokes with those of float64.

    Args:
        dtype: name of the precision that the strokes came in; it decides the bounds.
        image: what was painted.
        exact: the same in float64.
        gradient: field -> gradient; empty for no gradient.
        exact_gradient: the same in float64.
        strokes: whose gradients they are.
        pull: sum of |dL/dI| over the picture, what a gradient is large or small against.
        faults: what is already known to be broken.
        note: what is to be known besides.
    """
    slack = PICTURE[dtype]
    if not image.isfinite().all():
        faults = faults or "the picture is not finite"
    elif image.numel() and (image.min() < -slack or image.max() > 1 + slack):
        faults = faults or f"the picture goes from {float(image.min()):.3g} to {float(image.max()):.3g}"
    for name, value in gradient.items():
        if not value.isfinite().all():
            faults = faults or f"the gradient of {name} is not finite"
    if faults:
        return Judgement(Verdict.broken, note=faults)
    picture = float((image.double() - exact).abs().max())
    slopes = [gradient_error(gradient[name], exact_gradient[name], name, strokes, pull) for name in gradient]
    slope = max(slopes, default=None)
    seen, moved = picture > PICTURE[dtype], slope is not None and slope > GRADIENT[dtype]
    verdict = Verdict.degraded if seen or moved else Verdict.exact
    return Judgement(verdict, picture, slope, note, only_gradient=moved and not seen)


def gradient_error(value: Tensor, exact: Tensor, name: str, strokes: Strokes, pull: float) -> float:
    """|g - g64| / (|g64| + NEGLIGIBLE * pull), norms over all strokes.

    Gradients of points and widths, which are fractions of a window, count per pixel, so that large windows do not
    make rounding large.
    """
    if not len(value):
        return 0.0
    per_pixel = 0.5 * strokes.scale.double() if name in ("start", "control", "end", "width") else None
    difference, size = value.double() - exact.double(), exact.double()
    if per_pixel is not None:
        per_pixel = per_pixel.reshape(-1, *[1] * (value.ndim - 1))
        difference, size = difference / per_pixel, size / per_pixel
    return float(difference.norm() / (size.norm() + NEGLIGIBLE * pull + 1e-300))


def fault_of(strokes: Strokes, slack: float = 1e-6) -> str:
    """Which field of strokes is not finite or outside `FIELDS`; "" if none is."""
    for name, field in FIELDS.items():
        value = getattr(strokes, name).detach()
        if not value.isfinite().all():
            return f"{name} is not finite"
        room = slack * max(abs(field.low), abs(field.high))
        if len(value) and (value.min() < field.low - room or value.max() > field.high + room):
            return f"{name} goes from {float(value.min()):g} to {float(value.max()):g}"
    return ""
