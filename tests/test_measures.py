"""Tests of stroke measures, curves and metrics against slow references, including gradients and degenerate strokes."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from networks import saved, state_of
from scenes import leaves, random_strokes
from torch import Tensor
from torch.testing import assert_close
from torchmetrics.functional.image import structural_similarity_index_measure

from brushexp.compat.compiled import function
from brushexp.compositing.nearest import find_nearest, recall_nearest
from brushexp.compositing.tile_lists import AREA, NEAREST, TILE, F
from brushexp.painting.metrics import measure as measure_picture
from brushexp.painting.metrics import metrics_of, standard_metrics
from brushexp.plugins.metric.base import STANDARD, Metric
from brushexp.registry import build_named, plugin, register
from brushexp.results.quantities import quantities
from brushexp.strokes import measures as ruler
from brushexp.strokes.bezier import closest_parameter, curve_of, half_width_of, length_of, point_at, shape_of
from brushexp.strokes.catalogue import Strokes
from brushexp.system.runtime import share

SIZE = (60, 90)


def measure(strokes: Strokes) -> dict[str, Tensor]:
    """Return every stroke measure by name."""
    shape, width = shape_of(strokes), 2 * half_width_of(strokes)
    length, direction, near = length_of(shape), ruler.direction_of(shape), ruler.neighbours_of(strokes, shape)
    return {
        "length": length,
        "width": width,
        "area": ruler.area_of(length, width),
        "elongatedness": length / width.clamp_min(1e-3),
        "straightness": ruler.straightness_of(shape, length),
        "curvature": ruler.curvature_of(shape),
        "orientation": direction,
        "coherence": ruler.coherence_of(direction, near),
        "homogeneity": ruler.homogeneity_of(width, near),
    }


def polylines(strokes: Strokes, pieces: int = 4000) -> Tensor:
    """Sample each stroke's curve at evenly spaced t: points (N, pieces + 1, 2) in pixels."""
    t = torch.linspace(0, 1, pieces + 1, dtype=torch.float64)
    return point_at(curve_of(strokes)[:, None], t.expand(len(strokes), -1))


def test_shapes_agree_with_fine_polylines():
    made = random_strokes(60, SIZE, bend=0.4, dtype=torch.float64)
    measured, points = measure(made), polylines(made)
    step = points.diff(dim=1)
    length = step.norm(dim=-1).sum(1)
    assert_close(measured["length"], length, rtol=2e-3, atol=0)
    assert_close(measured["straightness"], step.sum(1).norm(dim=-1) / length, rtol=3e-3, atol=1e-4)
    heading = torch.atan2(step[..., 1], step[..., 0]).diff(dim=1)
    assert_close(measured["curvature"], ((heading + math.pi) % (2 * math.pi) - math.pi).abs().sum(1), rtol=0, atol=5e-3)
    assert_close(ruler.centre_of(curve_of(made)), points.mean(1), rtol=0, atol=0.01)
    for doubled, line in zip(measured["orientation"], points, strict=True):
        values, axes = torch.linalg.eigh(line.T.cov())
        x, y = axes[:, values.argmax()].tolist()
        if values.max() > 1.2 * values.min():
            assert_close(doubled, doubled.new_tensor([x * x - y * y, 2 * x * y]), rtol=0, atol=0.03)


def test_neighbourhoods_agree_with_the_double_loop_and_measures_have_the_right_slope():
    made = random_strokes(40, SIZE, dtype=torch.float64)
    measured, centres = measure(made), ruler.centre_of(curve_of(made))
    angle = 0.5 * torch.atan2(measured["orientation"][:, 1], measured["orientation"][:, 0])
    for i in range(40):
        near = (centres - centres[i]).norm(dim=1).argsort()[: ruler.NEIGHBOURS + 1]
        coherence = math.hypot(float((2 * angle[near]).cos().mean()), float((2 * angle[near]).sin().mean()))
        mean, spread = measured["width"][near].mean(), measured["width"][near].std(correction=0)
        assert float(measured["coherence"][i]) == pytest.approx(coherence, abs=2e-3)
        assert float(measured["homogeneity"][i]) == pytest.approx(float(mean / (mean + spread)))
    made = random_strokes(12, SIZE, dtype=torch.float64)
    fields = ("start", "control", "end", "width")

    def value(*inputs: Tensor) -> tuple[Tensor, ...]:
        measured = measure(replace(made, **dict(zip(fields, inputs, strict=True))))
        return tuple(measured[name] for name in ruler.MEASURES if name != "elongatedness")

    inputs = [getattr(made, field).clone().requires_grad_() for field in fields]
    assert torch.autograd.gradcheck(value, inputs, atol=1e-4, rtol=1e-3)


SHAPES = {
    "random": lambda s: {},
    "points": lambda s: {"control": s.start, "end": s.start},
    "almost points": lambda s: {"control": s.start + 1e-20, "end": s.start - 1e-20},
    "no width": lambda s: {"width": 0 * s.width},
    "one leg": lambda s: {"control": s.start},
    "hairpins": lambda s: {"end": s.start},
    "straight": lambda s: {"control": 0.5 * (s.start + s.end)},
    "equal": lambda s: {name: value[:1].expand_as(value) for name, value in s.items()} if len(s) else {},
    "huge": lambda s: {"start": 1e3 * s.start, "width": 1e3 * s.width, "scale": 1e6 + 0 * s.scale},
    "far": lambda s: {"position": 1e6 + s.position},
}


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("n", [0, 1, 2, 15])
def test_measures_are_finite_and_in_range_for_any_strokes(shape, n):
    strokes = random_strokes(n, SIZE, dtype=torch.float64)
    strokes = replace(strokes, **SHAPES[shape](strokes))
    exact = measure(strokes)
    for dtype in (torch.float32, torch.float64, torch.float16):
        made = strokes
        if dtype is torch.float16:  # values in the range of 16 bits are measured in 32
            made = made.map(lambda value: value.clamp(-1e4, 1e4).half().float())
        made = leaves(made, made.width.dtype if dtype is torch.float16 else dtype)
        measured = measure(made)
        sum(value.sum() for value in measured.values()).backward()
        for name, value in measured.items():
            assert value.isfinite().all(), name
            assert name == "orientation" or (value >= 0).all(), name
            high = math.pi if ruler.MEASURES[name].unit == "°" else ruler.MEASURES[name].high
            assert (value <= high + 1e-5).all(), name
            if dtype is torch.float32 and shape not in ("far", "hairpins", "huge"):
                assert_close(value.double(), exact[name], rtol=1e-3, atol=1e-3)
        assert all(value.grad is None or value.grad.isfinite().all() for _, value in made.items())


def test_known_shapes_have_known_measures_from_either_end_and_in_any_window():
    curve = torch.tensor([
        [[0, 0], [3, 4], [6, 8]], [[0, 0], [5, 1e4], [10, 0]], [[0, 0], [10, 0], [0, 0]], [[4, 4], [4, 4], [4, 4]],
    ], dtype=torch.float64)  # fmt: skip
    length, turn = length_of(curve), ruler.curvature_of(curve)
    assert_close(length[[0, 2, 3]], length.new_tensor([10, 10, 0]), rtol=2e-3, atol=1e-6)
    assert_close(turn, turn.new_tensor([0, math.pi, math.pi, 0]), rtol=0, atol=2e-3)
    assert_close(ruler.straightness_of(curve, length), length.new_tensor([1, 0, 0, 0]), rtol=0, atol=1e-3)
    direction = ruler.direction_of(curve)
    assert_close(direction[1], direction.new_tensor([-1, 0]), rtol=0, atol=0.01)  # although its ends lie side by side
    assert direction[3].tolist() == [0, 0]
    measured = torch.tensor([[1.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
    near = torch.tensor([[0, 1, 2], [1, 2, 1]])
    assert_close(ruler.mean_direction(measured, near), torch.tensor([[1.0, 0.0], [0.0, 0.0]]), rtol=0, atol=1e-3)
    assert ruler.mean_direction(measured, near[:, :0]).tolist() == [[0, 0], [0, 0]]
    made = random_strokes(50, SIZE, dtype=torch.float64)
    wider = {name: getattr(made, name) / 2 for name in ("start", "control", "end", "width")}
    for other in (replace(made, start=made.end, end=made.start), replace(made, scale=2 * made.scale, **wider)):
        for name, value in measure(other).items():
            assert_close(value, measure(made)[name], msg=name)


@pytest.mark.parametrize(("n", "k"), [(0, 3), (1, 3), (2, 3), (4, 3), (4, 10), (30, 4)])
def test_nearest_agrees_with_all_distances_and_no_stroke_is_its_own_neighbour(n, k):
    points = torch.rand(n, 2, dtype=torch.float64)
    order = torch.cdist(points, points).argsort(1)
    assert torch.equal(ruler.nearest_strokes(points, points, k, exclude_self=False), order[:, :k])
    assert torch.equal(ruler.nearest_strokes(points, points, k, exclude_self=True), order[:, 1 : k + 1])
    measured = ruler.nearest_strokes(0 * points, 0 * points, k, exclude_self=True)  # all in one place
    assert measured.shape == (n, min(k, max(n - 1, 0)))
    for i, row in enumerate(measured.tolist()):
        assert i not in row
        assert len(set(row)) == len(row)


def random_curves(n, bend, dtype=torch.float64):
    start, end = torch.rand(n, 2, dtype=dtype) * 30, torch.rand(n, 2, dtype=dtype) * 30
    return torch.stack([start, (start + end) / 2 + bend * torch.randn(n, 2, dtype=dtype), end], dim=1)


@pytest.mark.parametrize("bend", [0.0, 1.0, 10.0, 30.0])
def test_no_point_of_the_curve_is_nearer(bend):
    curves, points = random_curves(60, bend)[:, None], torch.rand(60, 50, 2, dtype=torch.float64) * 40 - 5
    t = closest_parameter(curves, points)
    measured = (point_at(curves, t) - points).norm(dim=-1)
    tried = torch.stack(
        [(point_at(curves, torch.full_like(t, s)) - points).norm(dim=-1) for s in torch.linspace(0, 1, 2001)]
    )
    excess = (measured - tried.min(0).values).flatten().sort().values
    assert excess[int(0.9995 * len(excess))] < 2e-3
    assert excess[-1] < 0.5, "near the tip of a fold a point may be given to the other leg, which is nearly as near"


def test_the_distance_is_found_wherever_it_is_within_reach_with_the_gradient_of_finite_differences():
    dot = torch.zeros(1, 3, 2, requires_grad=True)
    closest_parameter(dot, torch.ones(1, 2)).sum().backward()
    assert dot.grad.isfinite().all()
    curve, point = random_curves(4, 3.0), torch.rand(4, 2, dtype=torch.float64) * 30
    inputs = (curve.requires_grad_(), point.requires_grad_())
    assert torch.autograd.gradcheck(closest_parameter, inputs, eps=1e-7, atol=1e-4)
    curve, reach, corners = random_tiles(1000)
    found, recalled = np.empty((2, len(curve), AREA), F)
    share(search, len(curve), curve.reshape(-1, 6), reach, corners, found, recalled)
    y, x = np.divmod(np.arange(AREA), TILE)
    pixels = torch.from_numpy(corners[:, None] + np.stack([x, y], axis=1) + 0.5).double()
    curves = torch.from_numpy(curve).double()[:, None]
    exact = (point_at(curves, closest_parameter(curves, pixels)) - pixels).norm(dim=-1)
    within = exact <= torch.from_numpy(reach)[:, None]
    assert within.float().mean() > 0.3
    for t in (found, recalled):
        distance = (point_at(curves, torch.from_numpy(t).double()) - pixels).norm(dim=-1)
        assert (distance - exact)[within].max() < 1e-3
        assert (distance - exact).min() > -1e-3, "nothing comes nearer than it is"


@function
def search(begin, end, p, reach, corners, found, recalled):
    for i in range(begin, end):
        own, near = np.empty(2 * AREA, F), np.empty((1, AREA), np.uint16)
        ox, oy = corners[i, 0], corners[i, 1]
        find_nearest(p, i, reach[i], ox, oy, own, near, 0, True)
        found[i] = own[NEAREST * AREA :]
        recall_nearest(p, i, ox, oy, own, near, 0)
        recalled[i] = own[NEAREST * AREA :]


def random_tiles(n):
    """Make random curves (n, 3, 2), from straight ones to hairpins, their reach (n,), and nearby tiles (n, 2)."""
    generator = np.random.default_rng(0)
    length, reach = np.exp(generator.uniform(np.log([4, 1]), np.log([200, 40]), (n, 2))).T
    bend = length * np.exp(generator.uniform(np.log(0.05), np.log(6), n))
    chord, bend = (
        size[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        for size, angle in zip((length, bend), generator.uniform(0, 2 * np.pi, (2, n)), strict=True)
    )
    start = np.full((n, 2), 400.0)
    curve = np.stack([start, start + (chord - bend) / 2, start + chord], axis=1)
    t, angle = generator.uniform(0, [[1], [2 * np.pi]], (2, n))
    place = point_at(torch.from_numpy(curve), torch.from_numpy(t)).numpy()
    place += reach[:, None] * generator.uniform(0, 1, (n, 1)) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return curve.astype(F), reach.astype(F), (place // TILE * TILE).astype(F)


A, B = np.random.default_rng(0).integers(0, 256, (2, 40, 33, 3), dtype=np.uint8)


def test_standard_metrics_are_what_they_are_defined_as():
    measured = measure_picture(standard_metrics(), A, B)
    a, b = A / 255, B / 255
    slopes = [np.abs(np.diff(a - b, axis=axis)).ravel() for axis in (0, 1)]
    similarity = structural_similarity_index_measure(
        *(torch.tensor(x).permute(2, 0, 1)[None] for x in (a, b)), data_range=1.0
    )
    assert measured["psnr"] == pytest.approx(-10 * math.log10(((a - b) ** 2).mean()), abs=1e-4)
    assert measured["ssim"] == pytest.approx(float(similarity), abs=1e-6)
    assert measured["l1"] == pytest.approx(np.abs(a - b).mean())
    assert measured["edges"] == pytest.approx(np.concatenate(slopes).mean())
    assert list(measured) == ["psnr", "ssim", "l1", "edges", "perceptual", "perceptual_backbone"]
    pixel = measure_picture(standard_metrics(), A[:1, :1], A[:1, :1])
    assert (pixel["psnr"], pixel["ssim"], pixel["edges"]) == (math.inf, None, None)


def test_the_chosen_metrics_are_measured_and_the_official_distance_if_there_is_a_file(config, tmp_path):
    assert list(metrics_of(config())) == list(STANDARD)
    assert list(metrics_of(config("metric=[l1]"))) == ["psnr", "l1"]
    options = {"backbone": "alexnet", "weights": str(saved(tmp_path, state_of("alexnet")))}
    official = {"lpips": build_named("metric", "lpips", options)}
    measured = measure_picture(standard_metrics() | official, A, B)
    display = [torch.tensor(x).permute(2, 0, 1) / 255 for x in (A, B)]
    assert measured["lpips_alexnet"] == pytest.approx(float(official["lpips"].distance(*display)))
    assert measured == measure_picture(standard_metrics(), A, B) | {"lpips_alexnet": measured["lpips_alexnet"]}


@pytest.mark.usefixtures("hydra_restore_singletons")
def test_tables_and_pages_show_a_metric_as_its_class_says(monkeypatch):
    monkeypatch.setattr(plugin, "_members", dict(plugin._members))  # restores the registry afterwards

    @register("metric", "tint")
    class Tint(Metric):
        """Difference of the mean colours."""

        title, unit, digits, higher_is_better = "tint", "levels", 1, False

        def __call__(self, comparison):
            return 255 * float((comparison.image - comparison.target).mean().abs())

    display = quantities()["tint"]
    assert (display.name, display.digits, display.better, display.about) == (
        "tint, levels", 1, "lower", "Difference of the mean colours.",
    )  # fmt: skip
    assert list(quantities())[: len(STANDARD)] == list(STANDARD)
    assert list(quantities()).index("tint") < list(quantities()).index("seconds")
