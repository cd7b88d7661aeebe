"""Every registered loss: values and gradients of almost nothing, in every precision; and the slope of its value.

What a loss is worth is in test_loss_values, on a part of a canvas in test_part_losses.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch
import yaml
from brushexp_style.brushwork import brushwork_of
from brushexp_style.style import KERNELS
from scenes import random_strokes
from torch import Tensor
from torch.testing import assert_close

from brushexp.errors import UserError
from brushexp.pictures.focus import focus_weights
from brushexp.plugins.loss.base import Loss, PaintedView
from brushexp.registry import build_named, plugins
from brushexp.strokes.catalogue import Strokes

PRECISIONS = (torch.float64, torch.float32, torch.bfloat16, torch.float16)
CANVAS = (20, 30)  # of the strokes
OF_STROKES = [plugin.name for plugin in plugins("loss") if plugin.cls.looks_at == "strokes"]
OF_PICTURES = [plugin.name for plugin in plugins("loss") if plugin.name not in OF_STROKES]
KINDS = {name: (name, {}) for name in OF_PICTURES} | {f"style {k}": ("style", {"kernel": k}) for k in KERNELS}


def built(name: str, **options: object) -> Loss:
    """A loss by its name; that of brushwork compares with a painting of sixty strokes."""
    loss: Loss = build_named("loss", name, options)
    if name == "brushwork":
        loss.reference = brushwork_of(seen(random_strokes(60, (40, 50), seed=1)), (40, 50))
    return loss


def seen(strokes: Strokes) -> Strokes:
    return replace(strokes, width=strokes.width.clamp_min(0.1), opacity=strokes.opacity.clamp_min(0.2))


def visible(n: int) -> Strokes:
    return seen(random_strokes(n, CANVAS, seed=3, dtype=torch.float64))


def collinear(n: int, t: float) -> Strokes:
    """Control points on the line through both ends: between them for t in (0, 1), beyond them otherwise."""
    made = visible(n)
    return replace(made, control=made.start + t * (made.end - made.start))


def of(rows: list[list[float]]) -> Strokes:
    """Strokes of these start, control, end."""
    start, control, end = torch.tensor(rows, dtype=torch.float64).split(2, dim=1)
    return replace(visible(len(rows)), start=start, control=control, end=end)


FEW = {
    "none": Strokes.none(),
    "one": visible(1),
    "two": visible(2),
    "twelve identical": visible(1).map(lambda value: value.expand(12, *value.shape[1:]).clone()),
    "collinear, between": collinear(5, 0.5),
    "collinear, at the start": collinear(5, 0.0),
    "collinear, beyond": collinear(5, 3.0),
    "points": replace(visible(4), control=visible(4).start, end=visible(4).start),
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
    result = torch.autograd.grad(value, leaves, allow_unused=True)
    return value.detach(), [torch.zeros_like(x) if g is None else g for x, g in zip(leaves, result, strict=True)]


@pytest.mark.parametrize("kind", FEW | STEEP)
@pytest.mark.parametrize("name", OF_STROKES)
def test_few_strokes_have_a_value_and_a_gradient_in_every_precision(name, kind):
    strokes = (FEW | STEEP)[kind]
    exact, _ = judged_strokes(built(name), strokes, torch.float64)
    assert exact >= -1e-6 if len(strokes) else exact == 0
    for dtype in PRECISIONS[:3]:
        value, slopes = judged_strokes(built(name), strokes, dtype)
        assert value.shape == ()
        assert value.isfinite()
        assert all(slope.isfinite().all() and slope.dtype == dtype for slope in slopes)
        if dtype is torch.float32 and kind in FEW:
            assert_close(value.double(), exact.double(), rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("name", OF_STROKES)
def test_half_precision_costs_what_its_rounded_strokes_cost(name):
    """Only the strokes are rounded, not what is computed of them."""
    for dtype in (torch.bfloat16, torch.float16):
        rounded = visible(12).map(lambda value, to=dtype: value.to(to))
        value, _ = judged_strokes(built(name), rounded, dtype)
        exact, _ = judged_strokes(built(name), rounded, torch.float64)
        assert value.dtype == torch.float32
        assert_close(value.double(), exact.double(), rtol=1e-4, atol=1e-6)


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
    if hasattr(loss, "calls"):
        loss.calls.zero_()  # the same shift every time
    seen = image.to(dtype).requires_grad_()
    value = loss(PaintedView(seen, target.to(dtype), Strokes.none()))
    return value.detach(), torch.autograd.grad(value, seen)[0]


@pytest.mark.parametrize("name", KINDS)
def test_tiny_pictures_have_a_value_and_a_gradient_in_every_precision(name):
    """Smaller than the windows of ssim (11 pixels) and than what features of networks see (up to 200)."""
    loss = built(KINDS[name][0], **KINDS[name][1])
    for size in SIZES:
        for kind, (image, target) in pairs(*size).items():
            result = {dtype: judged_pictures(loss, image, target, dtype) for dtype in PRECISIONS}
            (exact, right), (single, near) = result[torch.float64], result[torch.float32]
            assert_close(single.double(), exact, rtol=3e-3, atol=1e-5, msg=f"{size} {kind}")
            assert (near - right).norm() <= 1e-2 * right.norm() + 1e-6, f"{size} {kind}"
            for dtype, (value, slope) in result.items():
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
            value, slope = judged_pictures(built("ssim"), image, target, dtype)
            exact, expected = judged_pictures(built("ssim"), *rounded, torch.float64)
            assert_close(value.double(), exact, rtol=1e-4, atol=1e-5)
            if dtype is torch.bfloat16:  # float16 has no numbers as small as slopes of many pixels
                assert (slope - expected).norm() <= 3e-2 * expected.norm()


SLOPES: dict[str, tuple[str, dict[str, object], tuple[int, int]]] = {
    "mse": ("mse", {}, (5, 8)), "l1": ("l1", {}, (5, 8)),
    **{f"ssim {size}": ("ssim", {}, size) for size in [(1, 1), (2, 7), (8, 12)]},
    **{f"perceptual {k}": ("perceptual", {"jitter": k, "taps": ["b1"]}, (4, 6)) for k in (0, 1, 3)},
    **{f"style {kernel}": ("style", {"kernel": kernel, "taps": ["stem", "b0"]}, (4, 5)) for kernel in KERNELS},
    "sinkhorn": ("sinkhorn", {}, (4, 6)), "sinkhorn, shrunk": ("sinkhorn", {"side": 8}, (5, 30)),
}  # fmt: skip
CASES = [*((name, False) for name in SLOPES), *((name, True) for name in ("mse", "l1", "ssim (2, 7)", "perceptual 0"))]


@pytest.mark.parametrize(("name", "focused"), CASES)
def test_a_loss_has_the_slope_of_its_value(name, focused):
    kind, options, size = SLOPES[name]
    loss, target = built(kind, **options).double(), torch.rand(3, *size, dtype=torch.float64)
    image = 0.9 * (target + 0.2 * torch.randn_like(target)).clamp(0, 1) + 0.05  # at 0 a mass has a kink
    focus = focus_weights(torch.rand(size), 8) if focused else None

    def value(picture: Tensor) -> Tensor:
        if hasattr(loss, "calls"):
            loss.calls.fill_(1)  # the same shift
        return loss(PaintedView(picture, target, Strokes.none(), focus=focus))

    assert torch.autograd.gradcheck(value, image.requires_grad_())


FIELDS = ("scale", "start", "control", "end", "width")


@pytest.mark.parametrize("name", OF_STROKES)
def test_a_loss_of_strokes_has_the_slope_of_its_value(name):
    loss = built(name, **({"k": 4, "every": 10_000} if name == "direction" else {})).double()
    strokes = random_strokes(7, (24, 40), dtype=torch.float64, width=(0.0, 0.5))
    strokes = seen(strokes) if name == "brushwork" else strokes  # which leaves out what cannot be seen
    nothing = torch.zeros(3, 24, 40, dtype=torch.float64)

    def value(*inputs: Tensor) -> Tensor:
        moved = replace(strokes, **dict(zip(FIELDS, inputs, strict=True)))
        return loss(PaintedView(nothing, nothing, moved))

    assert torch.autograd.gradcheck(value, [getattr(strokes, field).clone().requires_grad_() for field in FIELDS])


LIMITS = ["perceptual.jitter=4", "direction.k=0", "direction.every=0", "sinkhorn.side=0", "sinkhorn.epsilon=0.001"]
LIMITS += ["sinkhorn.epsilon=nan", "sinkhorn.iterations=0", "sinkhorn.floor=0", "style.scale=0"]


@pytest.mark.parametrize("typed", [*LIMITS, "style.kernel=cubic", "style.colors=none"])
def test_options_that_cannot_be_are_refused_before_work_starts(typed):
    (name, option), value = typed.partition("=")[0].split("."), yaml.safe_load(typed.partition("=")[2])
    with pytest.raises(UserError, match=rf"loss\.{typed} is not .*; try loss\.{name}\.{option}="):
        build_named("loss", name, {option: float("nan") if value == "nan" else value})
