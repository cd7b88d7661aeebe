"""Test that the tiles of a canvas on disk form one picture, and that painting continues after an interruption."""

import itertools
import json
import logging
import os
import signal
import subprocess
import sys
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import torch
from brushexp_canvases.grid import Grid, Tile
from brushexp_canvases.jobs import blocked_interrupts, paint_all, workers
from brushexp_canvases.page import write_strokes
from brushexp_canvases.store import NUMBERS, CanvasStore, rows_to_strokes, strokes_to_rows
from brushexp_canvases.task import begin, check_same, relevant_settings
from brushexp_canvases.tile import THICK, Canvas, draw_tile, job_of, paint_tile
from omegaconf import OmegaConf
from PIL import Image
from refusals import refuses
from skimage.data import astronaut

from brushexp.api.settings import settings_of
from brushexp.errors import UserError
from brushexp.pictures.region import Region
from brushexp.strokes.prior import sample_prior

SIZES = [(1, 1), (40, 40), (41, 40), (100, 70), (7, 300), (256, 256)]


@pytest.mark.parametrize("size", SIZES)
def test_tiles_cover_a_canvas_once_wait_for_earlier_rounds_only_and_windows_of_one_do_not_overlap(size):
    grid = Grid(size, side=40, margin=20)
    covered = np.zeros(size, int)
    for tile in grid.tiles():
        grid_region = grid.region(tile)
        covered[grid_region.top : grid_region.top + grid_region.height][
            :, grid_region.left : grid_region.left + grid_region.width
        ] += 1
    assert (covered == 1).all()
    for number in range(4):
        seen = np.zeros(size, int)
        for tile in (tile for tile in grid.tiles() if tile.round == number):
            window = grid.window(tile)
            seen[window.top : window.top + window.height, window.left : window.left + window.width] += 1
        assert seen.max() <= 1
    grid = Grid(size, side=40, margin=8)
    for tile in grid.tiles():
        assert all(other.round < tile.round for other in grid.before(tile))
        assert all(grid.before(other) for other in grid.around(tile))
        assert {tile} == set(grid.tiles_in(grid.region(tile)))


def test_one_small_tile_is_a_canvas_whose_strokes_are_the_same_after_they_were_stored(tmp_path):
    strokes, depth = sample_prior(7), torch.rand(7)
    again, depth_again = rows_to_strokes(strokes_to_rows(strokes, depth))
    assert strokes_to_rows(strokes, depth).shape == (7, NUMBERS)
    assert torch.equal(depth, depth_again)
    assert torch.equal(again.brush, strokes.brush)
    for name, value in strokes.items():
        assert torch.equal(getattr(again, name), value.float())
    assert len(rows_to_strokes(strokes_to_rows(sample_prior(0), torch.empty(0)))[0]) == 0
    Image.new("RGB", (5, 3), (200, 100, 0)).save(tmp_path / "small.png")
    store, _ = painted(tmp_path / "small.png", tmp_path / "small.zarr", pixels_per_stroke=4)
    assert store.grid.shape == (1, 1)
    assert np.isnan(store.errors()["seams"])
    assert json.loads((tmp_path / "small.zarr" / "zarr.json").read_text())["attributes"]["size"] == [3, 5]


@pytest.fixture(scope="module")
def picture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("pictures") / "astronaut.png"
    Image.fromarray(astronaut()[40:136, 170:298]).save(path)
    return path


def config_of(picture: Path, path: Path, **options: object) -> OmegaConf:
    chosen = {"look": "plain", "steps": 4, "pixels_per_stroke": 48, "tile": 48, "margin": 16, "seed": 3} | options
    return settings_of("canvas", {"image": str(picture), "canvas": str(path), **chosen}).cfg


def canvas_of(store: CanvasStore, cfg: OmegaConf) -> Canvas:
    settings = OmegaConf.to_container(cfg, resolve=True) | {"background": store.record["background"]}
    return Canvas(str(store.path), settings, "plugins")


def painted(picture: Path, path: Path, order: slice = slice(None), **options: object) -> tuple[CanvasStore, Canvas]:
    cfg = config_of(picture, path, **options)
    store = begin(path, cfg)
    canvas = canvas_of(store, cfg)
    for _, tiles in itertools.groupby(store.grid.tiles(), key=lambda tile: tile.round):
        for tile in list(tiles)[order]:
            paint_tile(canvas, tile)
    for tile in store.grid.tiles()[order]:
        draw_tile(canvas, tile)
    return store, canvas


@pytest.fixture(scope="module")
def done(picture: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[CanvasStore, Canvas]:
    return painted(picture, tmp_path_factory.mktemp("canvas") / "a.zarr")


def test_the_parts_are_those_of_one_picture_which_looks_like_the_target_and_the_page_gets_all_strokes(done, tmp_path):
    store, _ = done
    assert (store.counts > 0).all()
    assert int(store.counts.sum()) == pytest.approx(96 * 128 / 48, rel=0.25)
    assert store.errors()["mse"] < 0.01
    everything = Region(0, 0, *store.grid.size)
    difference = store.read("painting", everything).astype(float) - store.read("target", everything)
    assert np.square(difference / 255).mean() == pytest.approx(store.errors()["mse"])
    store, canvas = done
    cfg = OmegaConf.create(canvas.settings)
    everything = Region(0, 0, *store.grid.size)
    whole = job_of(store, cfg, everything).picture().transpose(2, 0, 1)
    assert np.abs(whole.astype(int) - store.read("painting", everything)).max() <= 1
    part = job_of(store, cfg, Region(10, 20, 30, 40)).picture().transpose(2, 0, 1)
    assert np.abs(part.astype(int) - whole[:, 10:40, 20:60]).max() <= 1
    store, canvas = done
    told = write_strokes(tmp_path, store.grid.size, partial(job_of, store, canvas.config))
    text = (tmp_path / "strokes_files" / "0_0.js").read_text()
    assert f'"count":{store.counts.sum()},' in text
    assert told["exact"]


def test_a_canvas_goes_on_with_its_settings_and_a_tile_that_was_not_finished_to_the_same_bits(picture, tmp_path, done):
    store, canvas = painted(picture, tmp_path / "c.zarr")
    tile = Tile(1, 1)
    before = strokes_to_rows(*store.strokes_of([tile]))
    store.root["strokes"][1, 1] = 0.5  # as if the process had been killed while writing the tile
    store.root["count"][1, 1] = -1
    assert not store.is_painted(tile)
    paint_tile(canvas, tile)
    np.testing.assert_array_equal(strokes_to_rows(*CanvasStore(store.path).strokes_of([tile])), before)
    store, _ = done
    check_same(store, config_of(picture, store.path, workers=2))
    refuses("begun with steps=4, but now steps=5", check_same, store, config_of(picture, store.path, steps=5))
    assert "workers" not in relevant_settings(config_of(picture, store.path))
    (tmp_path / "x.zarr").mkdir()
    refuses(r"x\.zarr", CanvasStore, tmp_path / "x.zarr")


def test_what_is_painted_is_not_painted_again_and_has_the_same_bits_in_any_order_within_a_round(
    done, picture, tmp_path
):
    store, canvas = done
    before = {path: path.stat().st_mtime_ns for path in store.path.rglob("*") if path.is_file()}
    for tile in store.grid.tiles():
        paint_tile(canvas, tile)
        draw_tile(canvas, tile)
    assert before == {path: path.stat().st_mtime_ns for path in store.path.rglob("*") if path.is_file()}
    store, _ = done
    other, _ = painted(picture, tmp_path / "b.zarr", slice(None, None, -1))
    for name in ("strokes", "count", "squares", "painting/0"):
        np.testing.assert_array_equal(store.root[name][:], other.root[name][:])


@pytest.mark.parametrize(("options", "message"), [
    ({"strokes": 100}, "pixels_per_stroke"),
    ({"order": "accuracy"}, "order=accuracy"),
    ({"margin": 40}, "margin=24"),
    ({"painter": "greedy"}, "painter=greedy"),
    ({"background": "transparent"}, "background"),
    ({"look": "watercolour"}, "set paper=smooth"),
    ({"image": "nowhere.tif"}, r"nowhere\.tif"),
])  # fmt: skip
def test_what_a_canvas_cannot_do_is_refused(picture: Path, tmp_path: Path, options: dict, message: str) -> None:
    refuses(message, config_of, picture, tmp_path / "d.zarr", **options)


def test_under_a_lamp_the_height_of_the_paint_is_stored(picture: Path, tmp_path: Path) -> None:
    store, canvas = painted(picture, tmp_path / "e.zarr", steps=0, **{"light.depth": 1})
    everything = Region(0, 0, *store.grid.size)
    height = job_of(store, canvas.config, everything).height()
    found = store.read("height", everything)[0].astype(float)
    assert height.std() > 0.05
    assert np.abs(found - (255 * height / (THICK * 48**0.5)).clip(0, 255)).mean() < 6  # medians are local


HAS_SLURM = pytest.mark.skipif(find_spec("dask_jobqueue") is None, reason="needs the extra slurm")


@pytest.fixture(autouse=True)
def _loud_again():
    levels = {name: logging.getLogger(name).level for name in logging.root.manager.loggerDict}
    yield
    for name, level in levels.items():
        logging.getLogger(name).setLevel(level)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_worker_that_dies_is_replaced_and_nothing_is_lost(picture: Path, tmp_path: Path) -> None:
    options = {"tile": 64, "pixels_per_stroke": 200, "steps": 2}
    store, _ = painted(picture, tmp_path / "here.zarr", **options)
    cfg = config_of(picture, tmp_path / "there.zarr", **options)
    other = begin(tmp_path / "there.zarr", cfg)
    with workers(1, None) as client:
        (first,) = client.run(os.getpid).values()

        def kill_once(done: int) -> None:
            if done == 1:
                os.kill(first, signal.SIGKILL)

        memory = paint_all(client, canvas_of(other, cfg), other.grid, other.grid.tiles(), kill_once)
        assert set(client.run(os.getpid).values()) != {first}
    assert memory > 50
    for name in ("strokes", "count", "squares", "painting/0"):
        np.testing.assert_array_equal(store.root[name][:], other.root[name][:])


def test_a_scheduler_that_is_not_there_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("brushexp_canvases.jobs.WAIT", "1s")
    with pytest.raises(UserError, match=r"tcp://127\.0\.0\.1:1 has no scheduler"), workers(1, "tcp://127.0.0.1:1"):
        pass


SBATCH = """#!/bin/sh
cp "$1" "$1.job"
setsid sh "$1.job" >/dev/null 2>&1 &
echo "Submitted batch job $!" | tee -a {log}
"""
SCANCEL = """#!/bin/sh
kill -- "-$1"
echo "cancelled $1" >> {log}
"""


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
@HAS_SLURM
def test_jobs_of_slurm_paint_a_canvas(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Image.new("RGB", (20, 12), (200, 100, 0)).save(tmp_path / "small.png")
    cfg = config_of(tmp_path / "small.png", tmp_path / "a.zarr", pixels_per_stroke=4, steps=1, cluster="slurm")
    store = begin(tmp_path / "a.zarr", cfg)
    for name, text in (("sbatch", SBATCH), ("scancel", SCANCEL)):
        (path := tmp_path / name).write_text(text.format(log=tmp_path / "log"))
        path.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    with workers(1, cfg.cluster) as client:
        paint_all(client, canvas_of(store, cfg), store.grid, store.grid.tiles(), lambda done: None)
    assert all(store.is_painted(tile) and store.is_drawn(tile) for tile in store.grid.tiles())
    said = (tmp_path / "log").read_text()
    job = said.splitlines()[0].split()[-1]
    assert f"cancelled {job}" in said
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler, "the handler of Ctrl-C is restored"


def test_ctrl_c_waits_while_workers_start_and_never_reaches_them():
    asked = "import signal; print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []))"
    steps = []
    with pytest.raises(KeyboardInterrupt), blocked_interrupts():  # noqa: PT012
        signal.raise_signal(signal.SIGINT)
        steps.append(subprocess.run([sys.executable, "-S", "-c", asked], capture_output=True, check=True).stdout)
    assert steps == [b"True\n"], "a worker started meanwhile receives no Ctrl-C"
    assert not signal.pthread_sigmask(signal.SIG_BLOCK, [])


@HAS_SLURM
def test_slurm_that_is_not_here_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(UserError, match="sbatch"), workers(1, "slurm"):
        pass
