"""Tests of every registered loss: its value and gradient in every precision, including for nearly empty inputs.

Losses on parts of a canvas are tested in test_features.
"""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import torch
import yaml
from brushexp_losses.direction import Direction
from brushexp_losses.lpips_loss import Lpips
from brushexp_losses.sinkhorn import Sinkhorn
from networks import saved, state_of, torchvision_features
from refusals import refuses
from scenes import leaves, random_strokes
from torch import Tensor
from torch.distributions import MultivariateNormal, kl_divergence
from torch.testing import assert_close
from torchmetrics.functional.image import lpips as published
from torchmetrics.functional.image import structural_similarity_index_measure

from brushexp.features.distance import bundled_distance, perceptual_distance
from brushexp.pictures.focus import focus_weights
from brushexp.plugins.loss.base import Loss, PaintedView
from brushexp.plugins.loss.brushwork import brushwork_of
from brushexp.plugins.loss.curvature import Curvature
from brushexp.plugins.loss.kl import SHRINK, KullbackLeibler
from brushexp.plugins.loss.l1 import MeanAbsoluteError
from brushexp.plugins.loss.mse import MeanSquaredError
from brushexp.plugins.loss.perceptual import Perceptual
from brushexp.plugins.loss.ssim import StructuralSimilarity
from brushexp.plugins.loss.style import KERNELS, Style
from brushexp.plugins.loss.width import Width
from brushexp.registry import build_named, plugins
from brushexp.strokes.bezier import curve_of
from brushexp.strokes.catalogue import Strokes
from brushexp.strokes.prior import INSET, clamp_to_prior, sample_prior

PRECISIONS = (torch.float64, torch.float32, torch.bfloat16, torch.float16)
CANVAS = (20, 30)  # of the strokes
OF_STROKES = [plugin.name for plugin in plugins("loss") if plugin.cls.looks_at == "strokes"]
OF_PICTURES = [plugin.name for plugin in plugins("loss") if plugin.name not in OF_STROKES]
KINDS = {name: (name, {}) for name in OF_PICTURES} | {f"style {k}": ("style", {"kernel": k}) for k in KERNELS}


def built(name: str, **options: object) -> Loss:
    """Build a loss by name; the brushwork loss gets a reference painting of sixty strokes."""
    loss: Loss = build_named("loss", name, options)
    if name == "brushwork":
        loss.reference = brushwork_of(seen(random_strokes(60, (40, 50), seed=1)), (40, 50))
    return loss


def seen(strokes: Strokes) -> Strokes:
    return replace(strokes, width=strokes.width.clamp_min(0.1), opacity=strokes.opacity.clamp_min(0.2))


def visible(n: int) -> Strokes:
    return seen(random_strokes(n, CANVAS, seed=3, dtype=torch.float64))


def collinear(n: int, t: float) -> Strokes:
    """Make strokes whose control point lies on the line through both ends, and between them if t is in (0, 1)."""
    made = visible(n)
    return replace(made, control=made.start + t * (made.end - made.start))


def of(rows: list[list[float]]) -> Strokes:
    """Make strokes from rows of start, control and end points."""
    start, control, end = torch.tensor(rows, dtype=torch.float64).split(2, dim=1)
    return replace(visible(len(rows)), start=start, control=control, end=end)


FEW = {
    "none": Strokes.none(),
    "one": visible(1),
    "two": visible(2),
    "twelve identical": visible(1)[torch.zeros(12, dtype=torch.long)],
    "collinear, between": collinear(5, 0.5),
    "collinear, at the start": collinear(5, 0.0),
    "collinear, beyond": collinear(5, 3.0),
    "points": replace(visible(4), control=visible(4).start, end=visible(4).start),
    "no width": replace(visible(3), width=0 * visible(3).width),
    "controls far away": replace(visible(4), control=torch.full((4, 2), 1e3).double()),
    "far off and huge": replace(visible(4), position=1e6 + visible(4).position, scale=1e6 * visible(4).scale / 30),
}
STEEP = {  # where single precision need not agree with double precision
    "a point and a line": of([[0.3] * 6, [0.5, 0.1, 0.0, 0.0, -0.5, -0.1]]),
    "huge width": replace(visible(3), width=1e3 + visible(3).width),
    "start is end": of([[0.3, 0.3, x, 1.0, 0.3, 0.3] for x in np.linspace(-1, 1, 5)]),
    "almost points": of([[0.3, 0.3, 1e3, -1e3, 0.3 + d, 0.3] for d in (1e-3, 1e-8, 1e-20, 1e-30)]),
    "control on an end": of([[0.5, 0.1, 0.5, 0.1, -0.5, y] for y in np.linspace(-1, 1, 5)]),
    "bends on a line": of([[0.5, 0.0, x, 2 * x, -0.5, 0.0] for x in np.linspace(-1e3, 1e3, 50)]),
    "bounds": of([[1e3, -1e3, -1e3, 1e3, 1e3, 1e3], [-1e3, 1e3, 1e3, 1e3, 0.0, 0.0]]),
}


def judged_strokes(loss: Loss, strokes: Strokes, dtype: torch.dtype) -> tuple[Tensor, list[Tensor]]:
    """Return the value and gradients of a loss on strokes of the given dtype."""
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
def test_half_precision_costs_what_its_rounded_strokes_cost_and_the_slope_is_that_of_the_value(name):
    """Only the strokes are rounded to half precision; the loss itself is computed in single precision."""
    for dtype in (torch.bfloat16, torch.float16):
        rounded = visible(12).map(lambda value, to=dtype: value.to(to))
        value, _ = judged_strokes(built(name), rounded, dtype)
        exact, _ = judged_strokes(built(name), rounded, torch.float64)
        assert value.dtype == torch.float32
        assert_close(value.double(), exact.double(), rtol=1e-4, atol=1e-6)
    loss = built(name, **({"k": 4, "every": 10_000} if name == "direction" else {})).double()
    strokes = random_strokes(7, (24, 40), dtype=torch.float64, width=(0.0, 0.5))
    strokes = seen(strokes) if name == "brushwork" else strokes  # which ignores invisible strokes
    nothing = torch.zeros(3, 24, 40, dtype=torch.float64)

    def value(*inputs: Tensor) -> Tensor:
        moved = replace(strokes, **dict(zip(FIELDS, inputs, strict=True)))
        return loss(PaintedView(nothing, nothing, moved))

    assert torch.autograd.gradcheck(value, [getattr(strokes, field).clone().requires_grad_() for field in FIELDS])


SIZES = [(1, 1), (3, 5), (10, 10)]


def pairs(height: int, width: int) -> dict[str, tuple[Tensor, Tensor]]:
    """Make named pairs of a picture and its target, in float64."""
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
    """Return a loss's value and gradient; both are computed in double precision for float64, otherwise in single."""
    loss = loss.double() if dtype is torch.float64 else loss.float()
    if hasattr(loss, "calls"):
        loss.calls.zero_()  # so that the shift is the same
    seen = image.to(dtype).requires_grad_()
    value = loss(PaintedView(seen, target.to(dtype), Strokes.none()))
    return value.detach(), torch.autograd.grad(value, seen)[0]


@pytest.mark.parametrize("name", KINDS)
def test_tiny_pictures_have_a_value_and_a_gradient_in_every_precision(name):
    """Losses accept pictures smaller than SSIM's window (11 px) and the networks' receptive fields (up to 200 px)."""
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
    """A naive SSIM would fail: bright flat pictures lose their variance in bfloat16, and sums overflow in float16."""
    for image, target in pairs(90, 70).values():
        for dtype in (torch.bfloat16, torch.float16):
            rounded = [picture.to(dtype).double() for picture in (image, target)]
            value, slope = judged_pictures(built("ssim"), image, target, dtype)
            exact, expected = judged_pictures(built("ssim"), *rounded, torch.float64)
            assert_close(value.double(), exact, rtol=1e-4, atol=1e-5)
            if dtype is torch.bfloat16:  # float16 cannot hold the small slopes of many pixels
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


LIMITS = ["perceptual.jitter=4", "direction.k=0", "direction.every=0", "sinkhorn.side=0", "sinkhorn.epsilon=0.001"]
LIMITS += ["sinkhorn.epsilon=nan", "sinkhorn.iterations=0", "sinkhorn.floor=0", "style.scale=0"]


@pytest.mark.parametrize("typed", [*LIMITS, "style.kernel=cubic", "style.colors=none"])
def test_options_that_cannot_be_are_refused_before_work_starts(typed):
    (name, option), value = typed.partition("=")[0].split("."), yaml.safe_load(typed.partition("=")[2])
    words = rf"loss\.{typed} is not .*; try loss\.{name}\.{option}="
    refuses(words, build_named, "loss", name, {option: float("nan") if value == "nan" else value})


NETWORKS = {"alexnet": "alex", "squeeze": "squeeze", "vgg16": "vgg"}  # and torchmetrics's names for them


def pictures(height: int = 5, width: int = 8, dtype: torch.dtype = torch.float64) -> tuple[Tensor, Tensor]:
    target = torch.rand(3, height, width, dtype=dtype)
    return (target + 0.2 * torch.randn_like(target)).clamp(0, 1), target


def judged(loss: Loss, image: Tensor, target: Tensor) -> Tensor:
    return loss(PaintedView(image, target, Strokes.none()))


@pytest.mark.parametrize(
    "made", [StructuralSimilarity, Lpips, partial(Perceptual, jitter=0), Sinkhorn, partial(Style, taps=["stem"])]
)
def test_a_target_is_looked_at_once_without_a_slope_until_another_comes(made):
    loss, looks = made(), []
    ask = loss.of_target
    loss.of_target = lambda target, look, key=None: ask(target, lambda seen: looks.append(1) or look(seen), key)
    image, target = pictures(12, 10, torch.float32)
    target.requires_grad_()
    for _ in range(3):
        judged(loss, image.requires_grad_(), target).backward()
    assert len(looks) == 1
    assert image.grad.isfinite().all()
    for other in (target.detach().clone(), torch.zeros_like(image)):
        assert_close(judged(loss, image, other), judged(made(), image, other))
    assert len(looks) == 3


@pytest.mark.parametrize(("loss", "power"), [(MeanSquaredError(), 2), (MeanAbsoluteError(), 1)])
def test_pixel_losses_average_over_pixels_and_channels(loss, power):
    image, target = pictures()
    pairs = zip(image.flatten().tolist(), target.flatten().tolist(), strict=True)
    assert float(judged(loss, image, target)) == pytest.approx(sum(abs(a - b) ** power for a, b in pairs) / 120)
    exact = target.clone().requires_grad_()
    value = judged(loss, exact, target)
    assert value == 0
    assert (torch.autograd.grad(value, exact)[0] == 0).all(), "of l1, too"


@pytest.mark.parametrize("size", [(6, 6), (11, 17), (37, 50)])
def test_ssim_agrees_with_torchmetrics(size):
    image, target = pictures(*size)
    expected = 1 - structural_similarity_index_measure(image[None], target[None], data_range=1.0)
    assert_close(judged(StructuralSimilarity(), image, target), expected, rtol=0, atol=1e-6)
    assert_close(judged(StructuralSimilarity(), image.float(), target.float()), expected.float(), rtol=0, atol=1e-4)


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (3, 5), (5, 40)])
def test_ssim_of_small_pictures_has_smaller_windows(size):
    image, target = pictures(*size)
    height, width = size
    down, across = min(5, height - 1), min(5, width - 1)
    steps = [np.exp(-((np.arange(-r, r + 1) / 1.5) ** 2) / 2) for r in (down, across)]
    weights = np.outer(*steps) / np.outer(*steps).sum()
    values = []
    for channel in range(3):
        x, y = (np.pad(p[channel].numpy(), ((down, down), (across, across)), mode="reflect") for p in (image, target))
        for row, column in np.ndindex(height, width):
            a, b = (p[row : row + 2 * down + 1, column : column + 2 * across + 1] for p in (x, y))
            m, n = (weights * a).sum(), (weights * b).sum()
            v, w, c = ((weights * p).sum() for p in ((a - m) ** 2, (b - n) ** 2, (a - m) * (b - n)))
            similar = (2 * m * n + 1e-4) / (m * m + n * n + 1e-4)
            values.append(1 - similar * (2 * c + 9e-4) / (v + w + 9e-4))
    assert float(judged(StructuralSimilarity(), image, target)) == pytest.approx(np.mean(values), abs=1e-9)


def perceptual(**options: object) -> Perceptual:
    return Perceptual(**({"jitter": 0} | options)).double()


def test_perceptual_is_the_mean_square_of_the_difference_of_features_and_has_a_slope_without_activation():
    image, target = pictures(22, 17)
    loss = perceptual(taps=["b1", "b3.expand"])
    ours, theirs = (loss.network(x[None], ["b1", "b3.expand"]) for x in (image, target))
    expected = {tap: np.mean((ours[tap] - theirs[tap]).numpy() ** 2) for tap in ours}
    assert float(judged(loss, image, target)) == pytest.approx(np.mean(list(expected.values())))
    assert float(judged(perceptual(), image, target)) == pytest.approx(expected["b3.expand"])
    distance = bundled_distance()
    distance.network.stem.weight.zero_()
    distance.network.stem.bias.zero_()
    picture = torch.rand(3, 6, 8, requires_grad=True)
    seen = distance.look(picture)
    assert (seen[0] == 0).all()
    distance.compare(seen, [torch.rand_like(value) for value in seen]).backward()
    assert picture.grad.isfinite().all()


def test_jitter_takes_four_shifts_in_turn_and_goes_on_after_a_restart():
    painting = PaintedView(*pictures(12, 10, torch.float32), Strokes.none())
    loss, second, third, sizes = Perceptual(jitter=3), Perceptual(jitter=3), Perceptual(jitter=3), set()
    loss.network.register_forward_pre_hook(lambda _, inputs: sizes.add(tuple(inputs[0].shape)))
    values = [float(loss(painting)) for _ in range(8)]
    assert len(set(values)) == 4
    assert values[:4] * 2 == values
    assert sizes == {(1, 3, 15, 13)}, "one size, so that the network's grid stays put"
    for _ in range(2):
        second(painting)
    assert list(second.state_dict()) == ["calls"]
    third.load_state_dict(second.state_dict())
    assert [float(third(painting)) for _ in range(4)] == values[2:6]
    for jitter in range(4):
        for rows in zip(*Perceptual(jitter=jitter).shifts, strict=True):
            assert set(rows) == set(range(jitter + 1)), "each row and column is gone through"


@pytest.mark.parametrize("name", NETWORKS)
def test_lpips_agrees_with_torchmetrics(tmp_path, monkeypatch, name):
    monkeypatch.setattr(published, "_get_tv_model_features", lambda net, _: torchvision_features(net))
    expected = published._LPIPS(net=NETWORKS[name])
    image, target = torch.rand(2, 3, 35, 51)
    loss = Lpips(backbone=name, weights=str(saved(tmp_path, state_of(name))))
    assert loss.label == f"lpips-{name}"
    assert_close(judged(loss, image, target), expected(image[None], target[None], normalize=True).squeeze())


def test_lpips_has_the_right_slope_and_is_by_default_the_distance_of_the_metrics(tmp_path):
    path = str(saved(tmp_path, state_of("squeeze")))
    image, target = pictures(9, 6)
    for loss in (Lpips().double(), Lpips(backbone="squeeze", weights=path).double()):
        value = partial(judged, loss, target=target)
        assert torch.autograd.gradcheck(lambda x, value=value: value(x), image.requires_grad_(), fast_mode=True)
    loss, (image, target) = Lpips(), pictures(40, 57, torch.float32)
    assert loss.label == "effl0"
    assert float(judged(loss, image, target)) == pytest.approx(perceptual_distance(image, target), rel=1e-6)


SIZE = (24, 40)
POINTS = ("start", "control", "end")
WANTED = torch.diag(torch.tensor([1 / 200, 1 / 25], dtype=torch.float64))


def scene(n: int, seed: int = 0, dtype: torch.dtype = torch.float64, bend: float = 0.3) -> Strokes:
    return random_strokes(n, SIZE, seed=seed, dtype=dtype, bend=bend, width=(0.0, 0.5))


def shaped(points: list[list[float]], width: list[float]) -> Strokes:
    """Make strokes from their widths and N rows of start, control and end points (6 numbers, in half-windows)."""
    table = torch.tensor(points, dtype=torch.float64)
    shape = dict(zip(POINTS, table.split(2, dim=1), strict=True))
    return replace(scene(len(width)), **shape, width=torch.tensor(width, dtype=torch.float64))


def costs(loss: Loss, strokes: Strokes) -> Tensor:
    nothing = strokes.color.new_zeros(3, *SIZE)
    return loss(PaintedView(nothing, nothing, strokes))


def test_width_compares_length_and_thickness_in_sides_of_the_window_and_thins_a_point():
    apart = [0.4, 0.0, 0, 0, -0.4, 0.0]  # 0.8 half-windows: 0.4 of the side
    for width, expected in ((0.1, 0.0), (0.28, 0.0), (0.5, 0.3), (1.0, 1.0)):
        assert float(costs(Width(), shaped([apart], [width]))) == pytest.approx(expected, abs=1e-12)
    made, total = scene(50), 0.0
    for start, end, width in zip(made.start.numpy(), made.end.numpy(), made.width.numpy(), strict=True):
        s, e = (start + 1) / 2, (end + 1) / 2  # as in the thesis: 0 to 1 within the window
        total += max(0.0, 2 * INSET * width - np.hypot(*(s - e)))
    assert float(costs(Width(), made)) == pytest.approx(total / 50)
    made = leaves(shaped([[0.1, 0.2, 0, 0, 0.1, 0.2]], [0.1]), torch.float64)
    value = costs(Width(), made)
    value.backward()
    assert float(value.detach()) == pytest.approx(0.14)
    assert (made.start.grad == 0).all()
    assert (made.end.grad == 0).all()
    assert made.control.grad is None
    assert made.width.grad.tolist() == pytest.approx([1.4])


def test_valid_strokes_cost_hardly_anything_and_curvature_agrees_with_the_loop():
    for made in (sample_prior(5000), clamp_to_prior(scene(500, dtype=torch.float32))):
        assert float(costs(Width(), made)) < 1e-8
    assert float(costs(KullbackLeibler(), sample_prior(5000))) < 0.01
    made = scene(40)
    total = 0.0
    for s, c, e in zip(made.start.numpy(), made.control.numpy(), made.end.numpy(), strict=True):
        (a, b), (x, y) = c - s, e - c
        total += abs((math.atan2(y, x) - math.atan2(b, a) + math.pi) % (2 * math.pi) - math.pi)
    assert float(costs(Curvature(), made)) == pytest.approx(total / 40, rel=1e-3)


def textbook_divergence(made: Strokes) -> float:
    """Compute the KL divergence by projecting each control point and applying torch's formula for two normals."""
    rows = []
    for start, control, end in zip(made.start.numpy(), made.control.numpy(), made.end.numpy(), strict=True):
        length = np.hypot(*(start - end))
        along = (start - end) / length
        across = np.array([[0, -1], [1, 0]]) @ along
        offset = (control - (start + end) / 2) / length
        rows.append([offset @ along, offset @ across])
    bends = torch.tensor(np.array(rows))
    mean = bends.mean(0)
    covariance = (bends - mean).T @ (bends - mean) / len(bends)
    measured = MultivariateNormal(mean, (1 - SHRINK) * covariance + SHRINK * WANTED)
    return float(kl_divergence(measured, MultivariateNormal(torch.zeros(2, dtype=torch.float64), WANTED)))


@pytest.mark.parametrize(("n", "bend"), [(2, 0.5), (3, 5.0), (100, 0.7), (100, 50.0)])
def test_kl_agrees_with_the_textbook_and_depends_on_neither_size_nor_place(n, bend):
    made = scene(n, seed=n, bend=bend)
    made = made[torch.linalg.vector_norm(made.start - made.end, dim=1) > 0.2]
    assert float(costs(KullbackLeibler(), made)) == pytest.approx(textbook_divergence(made), rel=1e-9)
    other = replace(made, **{name: 3 * getattr(made, name) - 0.5 for name in POINTS})
    assert_close(costs(KullbackLeibler(), made), costs(KullbackLeibler(), other))


def textbook_direction(strokes: Strokes, k: int) -> float:
    """Compute the mean of 4 sin^2 of the angles between each stroke's principal axis and those of its k neighbours."""
    t = torch.linspace(0, 1, 2001, dtype=torch.float64)[:, None]
    angle = []
    for start, control, end in curve_of(strokes):
        values, axes = torch.linalg.eigh(((1 - t) ** 2 * start + 2 * t * (1 - t) * control + t**2 * end).T.cov())
        angle.append(math.atan2(float(axes[1, values.argmax()]), float(axes[0, values.argmax()])))
    pairs = [(i, j) for i, row in enumerate(nearest_middles(strokes, k).tolist()) for j in row]
    return sum(4 * math.sin(angle[i] - angle[j]) ** 2 for i, j in pairs) / len(pairs)


def nearest_middles(strokes: Strokes, k: int) -> Tensor:
    middles = curve_of(strokes).mean(1)
    return torch.cdist(middles, middles).argsort(1)[:, 1 : k + 1]


@pytest.mark.parametrize("k", [1, 10, 60])
def test_direction_agrees_with_the_double_loop(k):
    made = scene(40, seed=k)
    assert float(costs(Direction(k=k), made)) == pytest.approx(textbook_direction(made, k), rel=5e-3)


def test_neighbours_are_kept_and_renewed_also_after_a_restart():
    loss, restarted = Direction(k=3, every=3), Direction(k=3, every=3)
    first, second = leaves(scene(20, seed=1), torch.float64), scene(20, seed=2)
    costs(loss, first).backward()
    assert first.start.grad.abs().sum() > 0
    assert first.position.grad is None, "which strokes are near has no slope"
    kept = loss.neighbours
    for _ in range(2):
        costs(loss, second)
        assert loss.neighbours is kept
    restarted.load_state_dict(loss.state_dict())
    costs(restarted, second)
    costs(loss, second)
    for one in (loss, restarted):
        assert torch.equal(one.neighbours, nearest_middles(second, 3))
    for n in (19, 2, 30):
        made = scene(n, seed=n)
        assert float(costs(loss, made)) == pytest.approx(textbook_direction(made, 3), rel=5e-3), "another number"
