"""What losses say of almost nothing: one stroke, one pixel, no gradient."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from brushexp_discriminator.discriminator import Discriminated
from scenes import random_strokes
from torch import Tensor
from torch.testing import assert_close

from brushexp.plugins.loss.base import Loss, PaintedView
from brushexp.plugins.loss.brushwork import BrushworkTransfer
from brushexp.plugins.loss.curvature import Curvature
from brushexp.plugins.loss.direction import Direction
from brushexp.plugins.loss.kl import KullbackLeibler
from brushexp.plugins.loss.l1 import MeanAbsoluteError
from brushexp.plugins.loss.lpips import Lpips
from brushexp.plugins.loss.mse import MeanSquaredError
from brushexp.plugins.loss.perceptual import Perceptual
from brushexp.plugins.loss.sinkhorn import Sinkhorn
from brushexp.plugins.loss.ssim import StructuralSimilarity
from brushexp.plugins.loss.style import KERNELS, Style, TapStyle
from brushexp.plugins.loss.width import Width
from brushexp.strokes.brushwork import Brushwork, brushwork_of
from brushexp.strokes.catalogue import Strokes

PRECISIONS = (torch.float64, torch.float32, torch.bfloat16, torch.float16)
CANVAS = (20, 30)  # of the strokes


def reference() -> Brushwork:
    made = random_strokes(60, (40, 50), seed=1)
    return brushwork_of(replace(made, width=made.width.clamp_min(0.1), opacity=made.opacity.clamp_min(0.2)), (40, 50))


def brushwork() -> BrushworkTransfer:
    loss = BrushworkTransfer()
    loss.reference = reference()
    return loss


STROKE_LOSSES: dict[str, Callable[[], Loss]] = {
    "kl": KullbackLeibler,
    "width": Width,
    "curvature": Curvature,
    "direction": Direction,
    "brushwork": brushwork,
    "discriminator": Discriminated,
}


def visible(n: int) -> Strokes:
    made = random_strokes(n, CANVAS, seed=3, dtype=torch.float64)
    return replace(made, width=made.width.clamp_min(0.1), opacity=made.opacity.clamp_min(0.2))


def identical(n: int) -> Strokes:
    return visible(1).map(lambda value: value.expand(n, *value.shape[1:]).clone())


def collinear(n: int, t: float) -> Strokes:
    """Control points on the line through both ends: between them for t in (0, 1), beyond them otherwise."""
    made = visible(n)
    return replace(made, control=made.start + t * (made.end - made.start))


def points(n: int) -> Strokes:
    made = visible(n)
    return replace(made, control=made.start, end=made.start)


def of(rows: list[list[float]]) -> Strokes:
    """Strokes of these start, control, end."""
    start, control, end = torch.tensor(rows, dtype=torch.float64).split(2, dim=1)
    return replace(visible(len(rows)), start=start, control=control, end=end)


FEW = {
    "none": Strokes.none(),
    "one": visible(1),
    "two": visible(2),
    "twelve identical": identical(12),
    "collinear, between": collinear(5, 0.5),
    "collinear, at the start": collinear(5, 0.0),
    "collinear, beyond": collinear(5, 3.0),
    "points": points(4),
    "no width": replace(visible(3), width=0 * visible(3).width),
    "controls far away": replace(visible(4), control=torch.full((4, 2), 1e3).double()),
    "far off and huge": replace(visible(4), position=1e6 + visible(4).position, scale=1e6 * visible(4).scale / 30),
}
STEEP = {  # of which single precision need not make what double precision does
    "a point and a line": of([[0.3] * 6, [0.5, 0.1, 0.0, 0.0, -0.5, -0.1]]),
    "huge width": replace(visible(3), width=1e3 + visible(3).width),
    "start is end": of([[0.3, 0.3, x, 1.0, 0.3, 0.3] for x in np.linspace(-1, 1, 5)]),
    "almost points": of([[0.3, 0.3, 1e3, -1e3, 0.3 + d, 0.3] for d in (1e-3, 1e-8, 1e-20, 1e-30)]),
    "control on an end": of([[0.5, 0.1, 0.5, 0.1, -0.5, y] for y in np.linspace(-1, 1, 5)]),
    "bends on a line": of([[0.5, 0.0, x, 2 * x, -0.5, 0.0] for x in np.linspace(-1e3, 1e3, 50)]),
    "bounds": of([[1e3, -1e3, -1e3, 1e3, 1e3, 1e3], [-1e3, 1e3, 1e3, 1e3, 0.0, 0.0]]),
}


def judged_strokes(loss: Loss, strokes: Strokes, dtype: torch.dtype) -> tuple[Tensor, list[Tensor]]:
    """Value and gradients of a loss of strokes in a dtype."""
    made = strokes.map(lambda value: value.to(dtype).clone().requires_grad_())
    picture = torch.zeros(3, *CANVAS, dtype=dtype)
    value = loss(PaintedView(picture, picture, made))
    leaves = [leaf for _, leaf in made.items()]
    found = torch.autograd.grad(value, leaves, allow_unused=True)
    return value.detach(), [torch.zeros_like(x) if g is None else g for x, g in zip(leaves, found, strict=True)]


@pytest.mark.parametrize("kind", FEW | STEEP)
@pytest.mark.parametrize("name", STROKE_LOSSES)
def test_few_strokes_have_a_value_and_a_gradient_in_every_precision(name, kind):
    strokes = (FEW | STEEP)[kind]
    exact, _ = judged_strokes(STROKE_LOSSES[name](), strokes, torch.float64)
    assert exact >= -1e-6 if len(strokes) else exact == 0
    for dtype in PRECISIONS[:3]:
        value, slopes = judged_strokes(STROKE_LOSSES[name](), strokes, dtype)
        assert value.shape == ()
        assert value.isfinite()
        assert all(slope.isfinite().all() and slope.dtype == dtype for slope in slopes)
        if dtype is torch.float32 and kind in FEW:
            assert_close(value.double(), exact.double(), rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("name", STROKE_LOSSES)
def test_half_precision_costs_what_its_rounded_strokes_cost(name):
    """Only the strokes are rounded, not what is computed of them."""
    for dtype in (torch.bfloat16, torch.float16):
        rounded = visible(12).map(lambda value, to=dtype: value.to(to))
        value, _ = judged_strokes(STROKE_LOSSES[name](), rounded, dtype)
        exact, _ = judged_strokes(STROKE_LOSSES[name](), rounded, torch.float64)
        assert value.dtype == torch.float32
        assert_close(value.double(), exact.double(), rtol=1e-4, atol=1e-6)


PICTURE_LOSSES: dict[str, Callable[[], Loss]] = {
    "mse": MeanSquaredError,
    "l1": MeanAbsoluteError,
    "ssim": StructuralSimilarity,
    "perceptual": Perceptual,
    "lpips": Lpips,
    "sinkhorn": Sinkhorn,
    **{f"style {kernel}": lambda kernel=kernel: Style(kernel=kernel) for kernel in KERNELS},
}
SIZES = [(1, 1), (3, 5), (10, 10)]


def pairs(height: int, width: int) -> dict[str, tuple[Tensor, Tensor]]:
    """Pictures and targets in float64."""
    image, target = torch.rand(2, 3, height, width, dtype=torch.float64)
    bright = torch.zeros_like(target)
    bright[:, height // 2, width // 2] = 1
    board = ((torch.arange(height)[:, None] + torch.arange(width)) % 2).to(target).expand(3, -1, -1).clone()
    return {
        "random": (image, target),
        "equal": (target.clone(), target),
        "black on white": (torch.zeros_like(target), torch.ones_like(target)),
        "grey on grey": (torch.full_like(target, 0.8), torch.full_like(target, 0.9)),
        "a board on its negative": (1 - board, board),
        "a bright pixel": (torch.zeros_like(bright), bright),
    }


def judged_pictures(loss: Loss, image: Tensor, target: Tensor, dtype: torch.dtype) -> tuple[Tensor, Tensor]:
    """Value, and gradient in the picture, by a loss in double precision for pictures in that, otherwise in single."""
    loss = loss.double() if dtype is torch.float64 else loss.float()
    if isinstance(loss, Perceptual):
        loss.calls.zero_()  # the same shift every time
    seen = image.to(dtype).requires_grad_()
    value = loss(PaintedView(seen, target.to(dtype), Strokes.none()))
    return value.detach(), torch.autograd.grad(value, seen)[0]


@pytest.mark.parametrize("name", PICTURE_LOSSES)
def test_tiny_pictures_have_a_value_and_a_gradient_in_every_precision(name):
    """Smaller than the windows of ssim (11 pixels) and than what features of networks see (up to 200)."""
    loss = PICTURE_LOSSES[name]()
    for size in SIZES:
        for kind, (image, target) in pairs(*size).items():
            found = {dtype: judged_pictures(loss, image, target, dtype) for dtype in PRECISIONS}
            (exact, right), (single, near) = found[torch.float64], found[torch.float32]
            assert_close(single.double(), exact, rtol=3e-3, atol=1e-5, msg=f"{size} {kind}")
            assert (near - right).norm() <= 1e-2 * right.norm() + 1e-6, f"{size} {kind}"
            for dtype, (value, slope) in found.items():
                assert value.shape == ()
                assert value >= -1e-12, (size, kind, dtype)
                assert value.isfinite(), (size, kind, dtype)
                assert slope.isfinite().all(), (size, kind, dtype)
                assert slope.dtype == dtype
                if kind == "equal":
                    assert abs(value) <= 1e-12, (size, dtype)
                    assert slope.abs().max() <= 1e-7, (size, dtype)


def test_ssim_in_half_precision_is_that_of_the_rounded_pictures():
    """In bfloat16 the variance of a bright even picture has no correct digit; sums overflow in float16."""
    for image, target in pairs(90, 70).values():
        for dtype in (torch.bfloat16, torch.float16):
            rounded = [picture.to(dtype).double() for picture in (image, target)]
            value, slope = judged_pictures(StructuralSimilarity(), image, target, dtype)
            exact, wanted = judged_pictures(StructuralSimilarity(), *rounded, torch.float64)
            assert_close(value.double(), exact, rtol=1e-4, atol=1e-5)
            if dtype is torch.bfloat16:  # float16 has no numbers as small as slopes of many pixels
                assert (slope - wanted).norm() <= 3e-2 * wanted.norm()


def judge_of(kernel: str, style: Tensor) -> TapStyle:
    unit = max(float(KERNELS[kernel].power(style)) / style.shape[1], 1e-8)
    judge = TapStyle(kernel, KERNELS[kernel].embedding(style), unit)
    return judge._replace(wanted=judge.sums(style)[1:] / style.shape[1])


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize(("channels", "positions"), [(1, 1), (1, 9), (5, 1), (1, 2), (5, 9)])
def test_statistics_of_one_channel_or_one_position_are_finite(kernel, channels, positions):
    torch.manual_seed(channels * positions)
    for style in (torch.rand(channels, positions), torch.zeros(channels, positions), torch.ones(channels, positions)):
        for dtype in PRECISIONS[:2]:
            wanted, seen = style.to(dtype), torch.rand(channels, positions).to(dtype).requires_grad_()
            judge = judge_of(kernel, wanted)
            value = judge.discrepancy(judge.sums(seen))
            (slope,) = torch.autograd.grad(value, seen)
            assert value.isfinite()
            assert value >= 0
            assert slope.isfinite().all()
            assert judge.discrepancy(judge.sums(wanted)) == 0
