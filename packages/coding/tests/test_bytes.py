"""Test that files stay within a given size and nearly fill it, and that impossible sizes are rejected."""

import json
import logging
from itertools import pairwise

import numpy as np
import pytest
import torch
from brushexp_coding.export import Bits
from brushexp_coding.fitting import LEAST_ERROR, code_within
from brushexp_coding.goal import BytesForStrokes
from brushexp_coding.metric import BitsPerPixel
from brushexp_coding.sizes import size_from, size_text
from catalogues import job_of
from hypothesis import given
from hypothesis import strategies as st
from refusals import refusal, refuses
from scenes import random_strokes, with_shapes
from skimage import io

import brushexp
from brushexp.painting.reopen import export_job
from brushexp.pictures.similarity import picture_psnr
from brushexp.plugins.metric.base import Comparison
from brushexp.registry import build_named
from brushexp.strokes.storage import load_catalogue

CANVAS = (48, 64)
PICTURE = (40, 56)


def painting(count=40, seed=0, **options):
    return job_of(with_shapes(random_strokes(count, CANVAS), seed), CANVAS, **options)


@pytest.mark.parametrize(
    ("text", "size"),
    [("1500", 1500), ("1500B", 1500), ("20kB", 20_000), ("20 KB", 20_000), ("0.5MB", 500_000), ("1.5k", 1500)],
)
def test_sizes_are_read(text, size):
    assert size_from(text, "size") == size


@pytest.mark.parametrize("text", ["", "kB", "20KiB", "-3kB", "1e3", "20kB.", "nan", "2 0kB"])
def test_what_is_no_size_is_refused_with_what_is_right(text):
    refuses("is not a size; give bytes, to.bits.size=1500B", build_named, "to", "bits", {"size": text})


@pytest.mark.parametrize("text", ["0", "0.2B", "2000MB"])
def test_sizes_beyond_all_files_are_refused(text):
    refuses("is not 1B to 1000MB; try metric.bits.size=20kB", build_named, "metric", "bits", {"size": text})


@given(st.integers(1, 10**9))
def test_a_written_size_is_no_smaller_and_little_larger(size):
    assert size <= size_from(size_text(size), "size") <= 1.01 * size + 1


@pytest.mark.parametrize(("count", "seed"), [(40, 0), (150, 1)])
def test_a_file_fits_and_is_the_better_the_larger_it_may_be(count, seed, tmp_path):
    job = painting(count, seed)
    drawn, quality = job.picture(), []
    for bits in (40, 60, 90, 130):
        size = count * bits // 8
        (path,) = Bits(size=f"{size}B", steps=12).write(job, tmp_path)
        assert 0.95 * size < path.stat().st_size <= size
        saved = load_catalogue(path)
        assert len(saved.strokes) == count
        quality.append(picture_psnr(export_job(saved).picture(), drawn))
    assert all(coarse + 1 < fine for coarse, fine in pairwise(quality)), quality


def test_descent_makes_a_better_file_of_the_same_size():
    job = painting(150)
    quick, slow = (code_within(job, size=1500, steps=steps, option="size") for steps in (0, 48))
    assert max(len(quick.data), len(slow.data)) <= 1500
    assert slow.loss < 0.8 * quick.loss


@pytest.mark.parametrize("count", [0, 1, 40])
def test_a_huge_size_takes_the_bytes_of_the_finest_rounding_only(count):
    coded = code_within(painting(count), size=10**9, steps=0, option="size")
    assert len(coded.data) < 100 + 40 * count
    assert coded.loss < 10 * LEAST_ERROR


@pytest.mark.parametrize("count", [1, 150])
def test_a_size_that_is_too_small_is_refused_with_one_that_works(count, tmp_path):
    job = painting(count)
    line = refusal(Bits(size="1B", steps=6).write, job, tmp_path)
    start, _, size = line.partition("; type to.bits.size=")
    assert start == f"to.bits.size=1B is too small for {count} strokes"
    assert not [*tmp_path.iterdir()], "no file is written"
    (path,) = Bits(size=size, steps=6).write(job, tmp_path)
    assert path.stat().st_size <= size_from(size, "size")
    if count > 1:
        smaller = f"{size_from(size, 'size') * 4 // 5}B"
        refuses(r", or paint about \d+ strokes$", Bits(size=smaller, steps=6).write, job, tmp_path)


def test_the_log_says_size_rate_and_quality(tmp_path, caplog):
    caplog.set_level(logging.INFO)
    job = painting()
    (path,) = Bits(size="400B", steps=0).write(job, tmp_path)
    size = path.stat().st_size
    drawn = export_job(load_catalogue(path)).picture()
    about = caplog.messages[-1]
    assert about.startswith(f"strokes.bits: {size} bytes, {8 * size / 40:.1f} bits per stroke, ")
    said = float(about.split(", ")[-1].split(" dB")[0])
    assert said == pytest.approx(picture_psnr(drawn, job.picture()), abs=0.2)


def test_the_metric_keeps_the_file_that_it_measures():
    job = painting(60)
    image = torch.from_numpy(job.picture()).permute(2, 0, 1) / 255
    metric = BitsPerPixel(size="700B", steps=0)
    bits = metric(Comparison(image, image, None, job.strokes, job))
    data = metric.files["strokes.bits"]
    assert metric.remarks["bytes"] == len(data) <= 700
    assert bits == 8 * len(data) / image[0].numel()
    assert BitsPerPixel(steps=0)(Comparison(image, image, None, job.strokes, job)) > bits


def test_a_metric_without_a_file_that_fits_warns(caplog):
    job = painting(60)
    image = torch.from_numpy(job.picture()).permute(2, 0, 1) / 255
    metric = BitsPerPixel(size="90B", steps=0)
    assert metric(Comparison(image, image, None, job.strokes, job)) is None
    assert not metric.files
    assert "strokes.bits was not written: bits=90B is too small for 60 strokes; type bits=" in caplog.text


@pytest.fixture(scope="module")
def photo(tmp_path_factory):
    y, x = np.mgrid[: PICTURE[0], : PICTURE[1]]
    waves = np.stack([np.sin(x / 5), np.cos(y / 7), np.sin((x + y) / 9)], -1)
    path = tmp_path_factory.mktemp("photo") / "waves.png"
    io.imsave(path, (127 + 100 * waves).astype(np.uint8))
    return path


@pytest.fixture(scope="module")
def paintings(photo, tmp_path_factory):
    """Paint a picture with each of two file size limits; return the paintings and their folders by limit."""
    painted = {}
    for size in (300, 900):
        folder = tmp_path_factory.mktemp("run")
        one = brushexp.paint(str(photo), bits=f"{size}B", steps=80, threads=1)
        one.save(folder)
        painted[size] = one, folder
    return painted


def test_a_painting_of_a_size_has_as_many_strokes_as_fit_and_leaves_the_file(paintings):
    quality = []
    for size, (one, folder) in paintings.items():
        path = folder / "strokes.bits"
        metrics = json.loads((folder / "metrics.json").read_text())
        saved = load_catalogue(path)
        assert path.stat().st_size == metrics["bytes"] <= size
        assert len(saved.strokes) == metrics["n_strokes"] == int((size - 60) * 8 / 85)
        assert saved.size == PICTURE
        target = one.target
        assert metrics["psnr_decoded"] == pytest.approx(picture_psnr(export_job(saved).picture(), target), abs=0.05)
        quality.append(metrics["psnr_decoded"])
    assert quality[0] + 2 < quality[1]


def test_a_saved_painting_of_a_size_is_exported_at_that_size_again(paintings, tmp_path):
    _, folder = paintings[900]
    job = export_job(load_catalogue(folder / "catalogue.h5"))
    (path,) = Bits(size="900B", steps=12).write(job, tmp_path)
    assert path.stat().st_size <= 900


def test_limits_that_are_typed_hold(photo):
    one = brushexp.paint(str(photo), bits="900B", max_strokes=12, steps=40, threads=1)
    assert len(one.strokes) == 12
    assert one.metrics["bytes"] <= 900


def test_only_a_typed_value_that_the_goal_overrides_is_reported(photo, caplog):
    keys = {"bits": "300B", "steps": 0, "threads": 1}
    brushexp.paint(str(photo), metric=["psnr", "ssim"], max_strokes=20, strokes=9, **keys)
    assert "change=bits" not in caplog.text
    one = brushexp.paint(str(photo), strokes=500, **keys)
    assert "change=bits sets strokes itself" in caplog.text
    assert one.metrics["bytes"] <= 300


def test_a_goal_that_holds_no_stroke_is_refused_before_any_work(photo):
    refuses("bits=1B holds no stroke; type bits=71B or more", brushexp.paint, str(photo), bits="1B")
    refuses("bits=much is not a size; give bytes, bits=1500B", brushexp.paint, str(photo), bits="much")
    one = brushexp.paint(str(photo), bits="71B", steps=0, threads=1)
    assert len(one.strokes) == 1


def test_without_a_size_the_change_changes_nothing():
    cfg = object()
    assert BytesForStrokes().settings(cfg) is cfg
