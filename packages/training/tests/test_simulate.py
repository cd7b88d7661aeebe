"""Test that interruptions do not change a simulated set, and that it never contains an incomplete file."""

import os
import resource
import signal
from pathlib import Path

import numpy as np
import pytest
import torch
from brushexp_training.evaluation.evaluation import GAP_PIXELS, stroke_sheet
from brushexp_training.stroke_sets import writer
from brushexp_training.stroke_sets.dataset import Origin, StrokeSet
from brushexp_training.stroke_sets.writer import BATCH_STROKES, simulate_set, to_rows
from program import disturb_move
from refusals import refuses
from test_dataset import SHARD_STROKES, N, Spot, write

from brushexp.plugins.engine.base import Simulated

ORIGIN = Origin("spot", {"radius": 0.25}, 6)  # the origin that `write` uses


@pytest.fixture
def small_shards(monkeypatch) -> None:
    monkeypatch.setattr(writer, "SHARD_STROKES", SHARD_STROKES)


def contents(path: Path) -> dict[str, bytes]:
    """Return the contents of all shards of a set, by file name."""
    return {file.name: file.read_bytes() for file in path.glob("*.h5")}


class Killed(BaseException):
    """An exception that stands in for the killing of a process."""


class Breaking(Spot):
    """An engine that raises `Killed` from stroke ``last`` on."""

    def __init__(self, last: int) -> None:
        super().__init__()
        self.last = last

    def __call__(self, parameters, *, seed, first=0):
        if first >= self.last:
            raise Killed
        return super().__call__(parameters, seed=seed, first=first)


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> dict[str, bytes]:
    """Return the contents of a set that was simulated without interruption."""
    return contents(write(tmp_path_factory.mktemp("whole") / "strokes", n=N))


@pytest.mark.parametrize("stops", [[0], [BATCH_STROKES], [300, 300, 1000], list(range(0, N - 70, 100))])
def test_a_set_made_in_pieces_is_the_same(tmp_path, small_shards, whole, stops):
    path = tmp_path / "strokes"
    for stop in stops:
        with pytest.raises(Killed):
            simulate_set(path, Breaking(stop), ORIGIN, 0, N)
        assert not stop or len(StrokeSet(path)) < N
    assert contents(write(path, n=N)) == whole
    for before in (3, SHARD_STROKES, 2 * SHARD_STROKES + 1, N - 1):
        path = write(tmp_path / f"{before}", n=before)
        assert len(StrokeSet(path)) == before
        assert contents(write(path, n=N)) == whole, "a grown set equals a set simulated at once"


@pytest.mark.parametrize("after", [False, True])
@pytest.mark.parametrize("number", [1, 2, 6])
def test_a_set_that_is_killed_where_a_shard_takes_its_place_is_the_same(
    tmp_path, small_shards, whole, monkeypatch, number, after
):
    def kill() -> None:
        raise Killed

    path = tmp_path / "strokes"
    with monkeypatch.context() as patched:
        patched.setattr(os, "replace", os.replace)
        disturb_move(".h5", number, after, kill)
        with pytest.raises(Killed):
            simulate_set(path, Spot(), ORIGIN, 0, N)
    assert len(contents(path)) == number - 1 + after
    assert contents(write(path, n=N)) == whole


def test_ctrl_c_keeps_what_is_simulated(tmp_path, small_shards, monkeypatch):
    monkeypatch.setattr(writer, "BATCH_STROKES", 32)
    path = tmp_path / "strokes"

    class Pressing(Spot):
        def __call__(self, parameters, *, seed, first=0):
            if first == 64:
                signal.raise_signal(signal.SIGINT)
            return super().__call__(parameters, seed=seed, first=first)

    with pytest.raises(KeyboardInterrupt):
        simulate_set(path, Pressing(), ORIGIN, 0, N)
    assert len(StrokeSet(path)) == 96
    assert simulate_set(path, Spot(), ORIGIN, 0, N) == N - 96
    assert simulate_set(path, Spot(), ORIGIN, 0, N) == 0


def test_what_killed_runs_leave_behind_does_no_harm_and_only_one_run_makes_a_set_at_a_time(tmp_path, whole, caplog):
    path = write(tmp_path / "strokes", n=N)
    (path / ".brushexp-abcd.h5").write_bytes(b"half")
    files = sorted(path.glob("0*.h5"))
    files[1].write_bytes(files[1].read_bytes()[:3000])
    files[2].unlink()
    assert contents(write(path, n=N)) == whole
    assert "it is simulated again" in caplog.text

    def again(*_: object, **__: object) -> Simulated:
        return simulate_set(tmp_path, Spot(), ORIGIN, 0, N)

    refuses("is being made by another run", simulate_set, tmp_path, again, ORIGIN, 0, N)
    assert simulate_set(tmp_path, Spot(), ORIGIN, 0, 40) == 40


@pytest.mark.parametrize(("origin", "seed", "n", "message"), [
    (Origin("blot", {"radius": 0.25}, 6), 0, N, "was made with engine=spot, this run has engine=blot"),
    (Origin("spot", {"radius": 0.5}, 6), 0, N, "engine.radius=0.25, this run has engine.radius=0.5"),
    (Origin("spot", {"radius": 0.25, "load": 1}, 6), 0, N, "no engine.load, this run has engine.load=1"),
    (Origin("spot", {"radius": 0.25}, 7), 0, N, "the window=6, this run has the window=7"),
    (ORIGIN, 1, N, "seed=0, this run has seed=1"),
    (ORIGIN, 0, 200, "already, more than n=200"),
])  # fmt: skip
def test_a_set_is_not_continued_with_other_settings(tmp_path, origin, seed, n, message):
    path = write(tmp_path / "strokes", n=300)
    before = contents(path)
    refuses(message, simulate_set, path, Spot(), origin, seed, n)
    assert contents(path) == before, "nothing was lost"


@pytest.mark.parametrize("room", [2000, 30_000])
def test_a_full_disk_or_a_file_in_the_way_ends_in_one_clear_line_and_nothing_is_lost(tmp_path, whole, room):
    path = write(tmp_path / "strokes", n=SHARD_STROKES)
    small = contents(path)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, hard))
    try:
        refuses(rf"cannot write {path}/.*with path=", write, path, n=N)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert contents(path) == small
    assert contents(write(path, n=N)) == whole
    file = path / "000000000.h5"
    for place in (file, file / "a"):
        refuses(r"cannot write .*; .*path=", simulate_set, place, Spot(), ORIGIN, 0, N)
    assert contents(path) == whole


def test_numbers_that_are_not_finite_are_refused_with_the_stroke_and_others_are_clipped():
    simulated = Spot()(torch.zeros(9, 10), seed=0)
    simulated.heights[7, 2, 3] = torch.nan
    refuses("the engine drew stroke 107 with numbers that are not finite", to_rows, torch.zeros(9, 10), simulated, 100)
    images = torch.tensor([-1.0, 2.0, 0.5])[:, None, None, None].expand(3, 4, 6, 6)
    heights = torch.tensor([-1.0, 1e6, 0.5])[:, None, None].expand(3, 6, 6)
    rows = to_rows(torch.zeros(3, 10), Simulated(images, heights), 0)
    assert rows["images"][:, 0, 0, 0].tolist() == [0, 255, 128]
    assert (rows["heights"][:, 0, 0] / 1024).tolist() == [0, 65535 / 1024, 0.5]
    assert rows["heights"].dtype == np.uint16


def test_the_sheet_shows_strokes_over_white():
    images = torch.zeros(13, 4, 6, 6)
    images[:, 0] = 1
    images[12, 3] = 1  # red; the others are transparent
    sheet = stroke_sheet(images, 10)
    pitch = 6 * 21 + GAP_PIXELS
    assert sheet.shape == (3, 2 * pitch + GAP_PIXELS, 10 * pitch + GAP_PIXELS)
    assert sheet[:, GAP_PIXELS, GAP_PIXELS].tolist() == [1, 1, 1]
    assert sheet[:, pitch + GAP_PIXELS, 2 * pitch + GAP_PIXELS].tolist() == [1, 0, 0]
