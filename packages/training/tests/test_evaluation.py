"""Test that the figures for renderers follow their formulas, and that ``task=evaluate`` writes them."""

import json
import math
import warnings
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.linalg
import torch
from brushexp_training.evaluation.benchmark import EXTREMES, draw_extremes
from brushexp_training.evaluation.evaluation import (
    FeatureDistance,
    bristle_figures,
    bristle_sums,
    error_figures,
    error_sums,
    fine_detail,
    inception_distance,
    over_white,
    premultiply,
    squared_error,
)
from brushexp_training.stroke_sets.dataset import Split, origin_of
from brushexp_training.stroke_sets.stroke_data import measured_count, stroke_data
from brushexp_training.stroke_sets.writer import simulate_set
from brushexp_training.tasks import evaluate
from hydra.core.hydra_config import HydraConfig
from PIL import Image
from refusals import refuses
from sweeps import read_csv
from test_dataset import write
from torch.nn import functional

from brushexp.config.check import check
from brushexp.pictures.similarity import psnr_of
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.base import RENDERERS, window_pictures
from brushexp.registry import build, build_named, plugins
from brushexp.strokes.prior import parameters_of, sample_prior

NAMES = [plugin.name for plugin in plugins("renderer")]
CPU = torch.device("cpu")
TINY = ("renderer=neural", "renderer.width=4", "renderer.dense=16", "renderer.code=2")


def distance(count: int = 5) -> FeatureDistance:
    """Return a feature distance whose features are the first ``count`` values of a picture."""
    return FeatureDistance("mine", lambda pictures: pictures.flatten(1)[:, :count], count)


def sample_set(n: int, shift: float = 0.0) -> torch.Tensor:
    """Return opaque pictures of random pixels."""
    images = 0.3 + shift + 0.3 * torch.rand(n, 4, 3, 4)
    images[:, 3] = 1
    return images


def test_fid_and_kid_are_their_formulas():
    ours, truth = sample_set(40), sample_set(40, shift=0.1)
    measure = distance()
    for part in (slice(0, 15), slice(15, 40)):
        measure.add(ours[part], truth[part])
    a, b = (images.flatten(1)[:, :5].double().numpy() for images in (ours, truth))
    means = np.square(a.mean(0) - b.mean(0)).sum()
    covariances = [np.cov(x, rowvar=False) for x in (a, b)]
    root = scipy.linalg.sqrtm(covariances[0] @ covariances[1]).real
    fid = means + np.trace(covariances[0] + covariances[1] - 2 * root)
    near = [(x @ y.T / 5 + 1) ** 3 for x, y in ((a, a), (b, b), (a, b))]
    within = sum((k.sum() - np.trace(k)) / (40 * 39) for k in near[:2])
    figures = measure.figures()
    assert figures["fid_mine"] == pytest.approx(fid, rel=1e-9)
    assert figures["kid_mine"] == pytest.approx(within - 2 * near[2].mean(), rel=1e-6)
    clear = torch.tensor([0.2, 0.4, 0.6, 0.5]).reshape(1, 4, 1, 1)
    torch.testing.assert_close(over_white(clear).flatten(), torch.tensor([0.6, 0.7, 0.8]))
    for n in (0, 1):
        few = distance()
        few.add(sample_set(n), sample_set(n))
        assert all(math.isnan(value) for value in few.figures().values()), "a set of one picture has no distance"


def test_distances_are_told_for_every_number_of_strokes_and_fall_with_it():
    measure = distance()
    torch.manual_seed(0)
    measure.add(sample_set(300), sample_set(300))
    rows = measure.by_number()
    assert [(row["n"], row["sets"]) for row in rows] == [(64, 4), (128, 2), (256, 1)]
    assert rows[0]["fid_mine"] > rows[2]["fid_mine"] > 0
    assert rows[0]["fid_mine_bias"] > rows[1]["fid_mine_bias"] > 0
    assert rows[0]["fid_mine_sd"] > 0
    assert math.isnan(rows[2]["fid_mine_sd"])


@pytest.mark.parametrize("shape", [(1, 1), (2, 3), (3, 4, 7), (2, 1, 64, 64)])
def test_fine_detail_is_what_the_mean_of_five_by_five_pixels_lacks(shape):
    planes = torch.rand(shape, dtype=torch.float64)
    mean = functional.avg_pool2d(planes.reshape(-1, 1, *shape[-2:]), 5, 1, 2, count_include_pad=False).reshape(shape)
    torch.testing.assert_close(fine_detail(planes), planes - mean)
    with torch.autocast("cpu", torch.bfloat16):
        torch.testing.assert_close(fine_detail(planes.float()), (planes - mean).float(), atol=1e-6, rtol=0)


def test_bristle_energy_is_the_share_of_fine_detail_that_is_drawn_and_strokes_without_light_have_none():
    parameters = parameters_of(sample_prior(40))
    truth = torch.rand(40, 4, 32, 32)
    smooth = truth.clone()
    smooth[:, 3] = 0.5
    half = truth.clone()
    half[:, 3] = 0.5 + 0.7 * (truth[:, 3] - 0.5)
    expected = {"bristles_thin": 1.0, "bristles_thick": 1.0, "light_thin": 1.0, "light_thick": 1.0}
    for images, share in ((truth, 1.0), (smooth, 0.0), (half, 0.49)):
        figures = bristle_figures(bristle_sums(images, truth, parameters))
        assert figures == pytest.approx(expected | {"bristles_thin": share, "bristles_thick": share}, abs=1e-6)
    parts = [bristle_sums(half[k::2], truth[k::2], parameters[k::2]) for k in range(2)]
    torch.testing.assert_close(sum(parts), bristle_sums(half, truth, parameters))
    parameters = parameters_of(sample_prior(40))
    truth = build_named("engine", "disc", {})(parameters, seed=0).images
    truth = (255 * truth).round() / 255  # rounded as in stored sets
    figures = bristle_figures(bristle_sums(truth + 0.01 * torch.rand_like(truth), truth, parameters))
    assert math.isnan(figures["light_thin"])
    assert math.isnan(figures["light_thick"])
    assert figures["bristles_thick"] > 0
    lit = truth.clone()
    lit[:, :3, ::2] += 2 / 255
    assert bristle_figures(bristle_sums(lit, lit, parameters))["light_thick"] == 1


class Bytes(torch.nn.Module):
    """A stand-in for the published Inception network, which takes pictures as bytes."""

    def __init__(self, count: int) -> None:
        super().__init__()
        self.count = count

    def forward(self, images: torch.Tensor, return_features: bool = False) -> torch.Tensor:
        assert images.dtype == torch.uint8
        assert return_features
        return images.float().flatten(1).repeat(1, 1 + self.count)[:, : self.count]


def scripted(path: Path, count: int) -> Path:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        torch.jit.script(Bytes(count)).save(str(path))
    return path


def test_inception_comes_from_a_file(tmp_path):
    measure = inception_distance(scripted(tmp_path / "i.pt", 2048), CPU)
    images = torch.rand(4, 4, 8, 9)
    measure.add(images, images)
    assert (measure.fid.real_features_sum.shape, measure.name) == ((2048,), "inception")
    (tmp_path / "text.pt").write_text("hello")
    scripted(tmp_path / "small.pt", 7)
    for name, message in (
        ("no.pt", "there is no such file; give inception-2015-12-05.pt"),
        ("text.pt", "is not Inception v3 as TorchScript"),
        ("small.pt", r"returns features \(1, 7\); give a network that returns \(1, 2048\)"),
    ):
        refuses(message, inception_distance, tmp_path / name, CPU)


@pytest.mark.parametrize("name", NAMES)
def test_no_stroke_makes_what_a_user_gets_other_than_a_number(name):
    renderer = build_named("renderer", name, {}).requires_grad_(False)
    outside = draw_extremes(renderer, build_named("engine", "disc", {}), 0)
    bare = hasattr(renderer, "project")
    assert list(outside.pictures) == ["painted", "bare"][: 1 + bare]
    assert len(outside.rows) == len(EXTREMES) * len(outside.pictures)
    assert all(row["finite"] for row in outside.rows if row["drawn"] == "painted")


def test_a_perfect_renderer_has_the_mass_of_the_nearest_stroke_of_the_seed():
    class Same:
        window = 24

        def __call__(self, parameters, *, seed, first=0):
            assert seed == 7
            return SimpleNamespace(images=window_pictures(Analytic(), parameters, 24))

    rows = {row["stroke"]: row for row in draw_extremes(Analytic(), Same(), 7).rows}
    assert rows["ordinary"]["alpha_mass"] == pytest.approx(1, rel=1e-5)
    assert rows["ordinary"]["l2"] == pytest.approx(0, abs=1e-12)
    assert rows["width 0"]["alpha_mass"] == pytest.approx(0, abs=1e-6)
    assert rows["width 0.5"]["alpha_mass"] > 1
    assert not rows["red 1.5"]["in_range"]


@pytest.fixture
def run(run_task):
    return partial(run_task, evaluate, "task=evaluate", "engine=disc", "engine.window=32", "n=20", "device=cpu")


def test_a_run_leaves_numbers_and_pictures(run, tmp_path):
    metrics = run("renderer=analytic", "renderer.soft=1")
    assert json.loads((tmp_path / "metrics.json").read_text()).keys() == metrics.keys()
    assert (metrics["n"], metrics["parameters"], metrics["file_mb"]) == (20, 0, None)
    assert metrics["finite_outside"]
    assert metrics["psnr_alpha"] > 15
    for key in ("l2", "fid_effl0", "kid_effl0", "strokes_per_second", "strokes_per_second_backward", "bristles_thin"):
        assert math.isfinite(metrics[key])
    for name in ("strokes.png", "outside.png"):
        with Image.open(tmp_path / name) as sheet:
            assert sheet.width > 8 * 64
    assert {row["stroke"] for row in read_csv(tmp_path / "outside.csv")} == set(EXTREMES)


def test_the_size_of_a_trained_renderer_is_told_and_that_it_is_not_trained(run, tmp_path, caplog):
    options = {"width": 4, "dense": 16, "code": 2, "checkpoint": None}
    renderer = build_named("renderer", "neural", options)
    path = tmp_path / "mine.safetensors"
    recipe = {"options": {**options, "window": 64, "brushes": 8, "stages": 2}}
    recipe["data"] = {"engine": "disc", "engine_config": {"window": 64}, "window": 64}
    RENDERERS.save(path, "neural", renderer, recipe)
    chosen = [*TINY, f"renderer.checkpoint={path}"]
    metrics = run(*chosen, "engine.window=64")
    assert metrics["file_mb"] == pytest.approx(path.stat().st_size / 1e6)
    assert metrics["parameters"] == sum(weight.numel() for weight in renderer.parameters())
    refuses(r"made with engine.window=32, .* other_data=true accepts it anyway", run, *chosen)
    assert run(*chosen, "other_data=true")["n"] == 20
    run(*TINY, "renderer.checkpoint=null")
    assert "neural has random weights; give the weights of task=train" in caplog.text


@pytest.mark.parametrize(("words", "brushes", "supersample", "seed"), [
    ([], 8, 2, 7),
    (["engine.brushes=8"], 8, 2, 7),
    (["engine.brushes=3", "other_data=true"], 3, 2, 0),
    (["engine.brushes=1"], 1, 2, 7),
    (["engine.supersample=1"], 8, 1, 7),
    (["engine.supersample=2"], 8, 2, 7),
])  # fmt: skip
def test_the_engine_is_that_of_the_training_unless_typed(words, brushes, supersample, seed, config, monkeypatch):
    typed = SimpleNamespace(overrides=SimpleNamespace(task=["task=evaluate", *words]))
    monkeypatch.setattr(HydraConfig, "initialized", lambda: True)
    monkeypatch.setattr(HydraConfig, "get", lambda: typed)
    data = stroke_data(config("task=evaluate", *words))
    options = data.origin.engine_config
    assert (options["brushes"], data.engine.brushes, options["supersample"]) == (brushes, brushes, supersample)
    assert data.first_seed == seed


def test_strokes_of_the_brushes_of_another_seed_are_refused_unless_wanted(config, tmp_path):
    for seed in (0, 7):  # the shipped network was trained on seed 7
        cfg = config("task=simulate", "engine.brushes=8", f"seed={seed}")
        engine = build(cfg.engine)
        simulate_set(tmp_path / str(seed), engine, origin_of(cfg.engine, engine), seed, 33)
    refused = ["task=evaluate", f"data={tmp_path / '0'}"]
    refuses(r"0 has brushes of seed 0, .* on brushes of seed 7; .* other_data=", check, config(*refused))
    check(config(*refused, "other_data=true"))
    check(cfg := config("task=evaluate", f"data={tmp_path / '7'}"))
    assert stroke_data(cfg).first_seed == 7


def test_errors_are_those_of_the_formulas_and_a_colour_without_paint_counts_nothing():
    images, truth = torch.rand(3, 4, 5, 7), torch.rand(3, 4, 5, 7)
    figures = error_figures(error_sums(images[:1], truth[:1]) + error_sums(images[1:], truth[1:]))
    a, b = images[:, 3:], truth[:, 3:]
    difference = torch.cat([images[:, :3] * a - truth[:, :3] * b, a - b], 1)
    assert figures["l2"] == pytest.approx(float(difference.square().mean()), rel=1e-5)
    assert figures["psnr_alpha"] == pytest.approx(-10 * math.log10(float((a - b).square().mean())), rel=1e-5)
    color = ((images[:, :3] - truth[:, :3]).square() * b).sum() / (3 * b.sum())
    assert figures["psnr_color"] == pytest.approx(-10 * math.log10(float(color)), rel=1e-5)
    truth = torch.rand(2, 4, 6, 8)
    truth[:, 3, :, 4:] = 0
    images = truth.clone()
    images[:, :3, :, 4:] = torch.rand(2, 3, 6, 4)
    assert squared_error(images, truth) == 0
    figures = error_figures(error_sums(images, truth))
    assert figures["psnr_alpha"] == figures["psnr_color"] == math.inf
    assert torch.equal(premultiply(images)[:, 3], images[:, 3])
    assert psnr_of(0.01) == pytest.approx(20)
    truth[:, 3] = 0
    assert math.isnan(error_figures(error_sums(images, truth))["psnr_color"]), "there is no paint"


def test_a_set_with_fewer_strokes_than_asked_for_is_told(config, tmp_path, caplog):
    data = stroke_data(config("task=evaluate", f"data=[{write(tmp_path / 'strokes', n=96, window=64)}]"))
    size = data.size(Split.TEST)
    assert [measured_count(data, Split.TEST, n) for n in (None, size)] == [size, size]
    assert not caplog.records
    assert measured_count(data, Split.TEST, size + 1) == size
    assert f"n={size + 1}: the set has only {size} strokes for split=test, which are measured" in caplog.text
