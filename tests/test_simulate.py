"""Making a set of strokes: the same whatever happens on the way, never half a file at its place."""

import random
import resource
import shutil
import signal
import time
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from program import Program
from test_dataset import Spot, write

from brushexp.app.checks import Simulate, check_keys
from brushexp.app.tasks.simulate import COLUMNS, GAP, contact_sheet
from brushexp.errors import UserError
from brushexp.plugins.engine.base import Simulated
from brushexp.strokes.prior import parameters_of, sample_prior
from brushexp.training.dataset import Origin, StrokeFile, unfinished
from brushexp.training.recording import BATCH, Recording

N = 5 * BATCH + 70
ORIGIN = Origin("spot", {"radius": 0.25}, 6)  # as `write` has it
PLUGIN = '''
"""An engine for the test of simulate."""

import time

import torch

from brushexp.app.checks import Simulate, check_keys
from brushexp.plugins.engine.base import Engine, Simulated
from brushexp.registry import register


@register("engine", "test_spot")
class Spot(Engine):
    """A grey window, its opacity decided by the number of the stroke."""

    def __init__(self, *, window: int = 6, rest: float = 0.0, radius: float = 0.5) -> None:
        self.window, self.rest, self.radius = window, rest, radius

    def __call__(self, parameters, *, seed, first=0):
        time.sleep(self.rest)
        alpha = torch.sin(torch.arange(first, first + len(parameters)) + seed * self.radius).square()
        alpha = alpha[:, None, None].expand(-1, self.window, self.window)
        return Simulated(torch.stack([0.5 * alpha, alpha, 1 - alpha, alpha], 1), alpha)
'''


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A folder with a plugin."""
    path = tmp_path_factory.mktemp("simulate")
    (path / "plugins").mkdir()
    (path / "plugins" / "spot.py").write_text(PLUGIN)
    return path


def start(folder: Path, *overrides: str) -> Program:
    """The program, which finds the plugin."""
    return Program("task=simulate", "threads=1", *overrides, cwd=folder, BRUSHEXP_PLUGINS=str(folder / "plugins"))


def run(folder: Path, *overrides: str) -> tuple[int, str]:
    """The same, finished: exit code and what it said."""
    process = start(folder, *overrides)
    out, err = process.communicate(timeout=120)
    return process.returncode, out + err


def record(path: Path, first: int, last: int) -> None:
    """Make batches ``first`` to ``last - 1`` of N strokes and leave, as a killed run does."""
    with Recording(path, ORIGIN, 0, N) as recording:
        assert recording.done == min(first * BATCH, N)
        for number, size in list(recording.batches())[: last - first]:
            parameters = parameters_of(sample_prior(size, 0, number))
            recording.add(parameters, Spot()(parameters, seed=0, first=number))


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> bytes:
    """A set that was made in one go."""
    return write(tmp_path_factory.mktemp("whole") / "strokes.h5", n=N).read_bytes()


@pytest.mark.slow
def test_a_killed_run_continues_and_makes_the_same_file(folder):
    n = 20 * BATCH + 5
    settings = ["engine=test_spot", "engine.rest=0.03", f"n={n}", f"seed={2**64 - 1}"]
    options = [*settings, "path=killed/strokes.h5"]
    path = folder / "killed" / "strokes.h5"
    chance = random.Random(0)
    done = []
    for stop in (signal.SIGKILL, signal.SIGKILL, signal.SIGINT):
        process = start(folder, *options)
        while len(list(unfinished(path).glob("0*.h5"))) <= (done or [0])[-1] and process.poll() is None:
            time.sleep(0.005)
        time.sleep(chance.random() * 0.2)
        process.send_signal(stop)
        _, err = process.communicate(timeout=60)
        assert process.returncode in (-9, 130), err
        assert not path.exists()
        with pytest.raises(UserError, match="is not finished; finish it with"):
            StrokeFile(path)
        done.append(len(list(unfinished(path).glob("0*.h5"))))
    assert 0 < done[0] < done[1] < done[2] < 20
    code, said = run(folder, *options)
    assert code == 0, said
    assert "strokes are there already; going on" in said
    assert [entry.name for entry in path.parent.iterdir()] == ["strokes.h5"]
    code, said = run(folder, *settings, "output=go")
    assert code == 0, said
    assert (folder / "go" / "strokes.h5").read_bytes() == path.read_bytes()
    with Image.open(folder / "go" / "strokes.png") as sheet:
        assert sheet.width > 1000
    file = StrokeFile(path)
    assert (file.engine, file.seed) == ("test_spot", 2**64 - 1)
    assert file.engine_config == {"window": 6, "rest": 0.03, "radius": 0.5}


def test_every_key_has_a_value(config):
    cfg = config("task=simulate")
    assert (cfg.n, cfg.path, cfg.seed) == (10000, None, 0)
    check_keys(cfg, Simulate)
    with pytest.raises(UserError, match="n=0 is not a number of strokes; set n to 1 or more"):
        check_keys(config("task=simulate", "n=0"), Simulate)


@pytest.mark.parametrize("stops", [[1], [5], [2, 2, 4], [1, 2, 3, 4, 5, 6]])
def test_a_set_made_in_pieces_is_the_same_byte_for_byte(tmp_path, whole, stops):
    done = 0
    for stop in stops:
        record(tmp_path / "strokes.h5", done, stop)
        done = stop
    assert write(tmp_path / "strokes.h5", n=N).read_bytes() == whole
    assert [path.name for path in tmp_path.iterdir()] == ["strokes.h5"]


@pytest.mark.parametrize("before", [3, BATCH, 2 * BATCH + 1, N - 1])
def test_a_finished_set_that_grows_is_the_same_as_one_made_large(tmp_path, whole, before):
    path = write(tmp_path / "strokes.h5", n=before)
    record(path, before // BATCH, before // BATCH + 1)
    assert len(StrokeFile(path)) == before, "the smaller set stays until the larger one is complete"
    assert write(path, n=N).read_bytes() == whole


def test_an_unfinished_set_can_become_larger(tmp_path, whole):
    path = tmp_path / "strokes.h5"
    with Recording(path, ORIGIN, 0, BATCH + 3) as recording:
        for first, size in recording.batches():
            parameters = parameters_of(sample_prior(size, 0, first))
            recording.add(parameters, Spot()(parameters, seed=0, first=first))
    assert write(path, n=N).read_bytes() == whole


def test_what_killed_runs_leave_behind_does_no_harm(tmp_path, whole, caplog):
    path = tmp_path / "strokes.h5"
    record(path, 0, 4)
    rest = unfinished(path)
    (rest / ".00000004-abcd.h5").write_bytes(b"half")
    (rest / "whole.h5").write_bytes(b"half")
    (rest / "00000001.h5").write_bytes((rest / "00000001.h5").read_bytes()[:3000])
    (rest / "00000002.h5").unlink()
    with Recording(path, ORIGIN, 0, N) as recording:
        assert recording.done == BATCH
        assert "is damaged" in caplog.text
    assert write(path, n=N).read_bytes() == whole
    shutil.copytree(path.parent, tmp_path / "copy")
    rest.mkdir()  # killed after the file was moved to its place
    assert write(path, n=N).read_bytes() == whole
    assert not rest.exists()


@pytest.mark.parametrize("finished", [False, True])
@pytest.mark.parametrize(
    ("origin", "seed", "n", "message"),
    [
        (Origin("blot", {"radius": 0.25}, 6), 0, N, "was made with engine=spot, this run has engine=blot"),
        (Origin("spot", {"radius": 0.5}, 6), 0, N, "engine.radius=0.25, this run has engine.radius=0.5"),
        (Origin("spot", {"radius": 0.25, "load": 1}, 6), 0, N, "no engine.load, this run has engine.load=1"),
        (Origin("spot", {"radius": 0.25}, 7), 0, N, "the window=6, this run has the window=7"),
        (ORIGIN, 1, N, "seed=0, this run has seed=1"),
        (ORIGIN, 0, 200, "already, more than n=200"),
    ],
)
def test_a_set_is_not_continued_with_other_settings(tmp_path, whole, finished, origin, seed, n, message):
    path = tmp_path / "strokes.h5"
    if finished:
        path.write_bytes(whole)
    else:
        record(path, 0, 3)
    with pytest.raises(UserError, match=message), Recording(path, origin, seed, n):
        pass
    assert write(path, n=N).read_bytes() == whole, "nothing was lost"


def test_only_one_run_makes_a_set_at_a_time(tmp_path):
    path = tmp_path / "strokes.h5"
    other = Recording(path, ORIGIN, 0, N)
    with Recording(path, ORIGIN, 0, N), pytest.raises(UserError, match="is being made by another run"):
        other.__enter__()
    with Recording(path, ORIGIN, 0, N):
        pass


def test_a_file_of_another_kind_is_not_overwritten(tmp_path):
    path = tmp_path / "strokes.h5"
    path.write_bytes(b"precious")
    with pytest.raises(UserError, match="not an HDF5 file"), Recording(path, ORIGIN, 0, N):
        pass
    assert path.read_bytes() == b"precious"


@pytest.mark.parametrize("room", [2000, 30_000])
def test_a_full_disk_ends_in_one_clear_line_and_nothing_is_lost(tmp_path, whole, room):
    path = write(tmp_path / "strokes.h5", n=BATCH)
    small = path.read_bytes()
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, hard))
    try:
        with pytest.raises(UserError) as caught:
            write(path, n=N)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert f"cannot write {path}: " in str(caught.value)
    assert "choose another place with path=" in str(caught.value)
    assert path.read_bytes() == small
    assert not (unfinished(path) / "whole.h5").exists()
    assert write(path, n=N).read_bytes() == whole


def test_a_place_that_cannot_be_written_is_explained(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(UserError, match=r"cannot write .*; .*path="), Recording(tmp_path / "file/a.h5", ORIGIN, 0, N):
        pass


def test_numbers_that_are_not_finite_are_refused_with_the_stroke(tmp_path):
    with Recording(tmp_path / "strokes.h5", ORIGIN, 0, N) as recording:
        parameters = parameters_of(sample_prior(BATCH))
        simulated = Spot()(parameters, seed=0)
        simulated.heights[7, 2, 3] = torch.nan
        with pytest.raises(UserError, match="the engine drew stroke 7 with numbers that are not finite"):
            recording.add(parameters, simulated)
        assert recording.done == 0


def test_what_lies_outside_the_range_of_the_file_is_clipped(tmp_path):
    path = tmp_path / "strokes.h5"
    with Recording(path, ORIGIN, 0, 3) as recording:
        images = torch.tensor([-1.0, 2.0, 0.5])[:, None, None, None].expand(3, 4, 6, 6)
        heights = torch.tensor([-1.0, 1e6, 0.5])[:, None, None].expand(3, 6, 6)
        recording.add(torch.zeros(3, 10), Simulated(images, heights))
        recording.finish()
    file = StrokeFile(path)
    assert file.pictures(np.arange(3))[:, 0, 0, 0].tolist() == [0, 255, 128]
    assert file.heights(np.arange(3))[:, 0, 0].tolist() == [0, 65535 / 1024, 0.5]


def test_the_sheet_shows_strokes_over_white(tmp_path):
    path = tmp_path / "strokes.h5"
    with Recording(path, ORIGIN, 0, 13) as recording:
        images = torch.zeros(13, 4, 6, 6)
        images[:, 0] = 1
        images[12, 3] = 1  # red; the others are clear
        recording.add(torch.zeros(13, 10), Simulated(images, torch.zeros(13, 6, 6)))
        recording.finish()
    sheet = contact_sheet(StrokeFile(path))
    pitch = 6 * 21 + GAP
    assert sheet.shape == (2 * pitch + GAP, COLUMNS * pitch + GAP, 3)
    assert sheet[GAP, GAP].tolist() == [255, 255, 255]
    assert sheet[pitch + GAP, 2 * pitch + GAP].tolist() == [255, 0, 0]
