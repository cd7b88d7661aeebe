"""The workers of a Dask cluster paint a canvas, also when one of them dies."""

import logging
import os
import signal
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from brushexp_canvases.jobs import out_of_reach, paint_all, workers
from brushexp_canvases.task import begin
from PIL import Image
from test_canvases import canvas_of, config_of, painted, picture  # noqa: F401  (a fixture)

from brushexp.errors import UserError

HAS_SLURM = pytest.mark.skipif(find_spec("dask_jobqueue") is None, reason="needs the extra slurm")


@pytest.fixture(autouse=True)
def _loud_again():
    levels = {name: logging.getLogger(name).level for name in logging.root.manager.loggerDict}
    yield
    for name, level in levels.items():
        logging.getLogger(name).setLevel(level)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_worker_that_dies_is_replaced_and_nothing_is_lost(picture: Path, tmp_path: Path) -> None:  # noqa: F811
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
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler, "Ctrl-C does what it did"


def test_ctrl_c_waits_while_workers_start_and_never_reaches_them():
    asked = "import signal; print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []))"
    steps = []
    with pytest.raises(KeyboardInterrupt), out_of_reach():  # noqa: PT012
        signal.raise_signal(signal.SIGINT)
        steps.append(subprocess.run([sys.executable, "-S", "-c", asked], capture_output=True, check=True).stdout)
    assert steps == [b"True\n"], "a worker that is begun meanwhile hears none"
    assert not signal.pthread_sigmask(signal.SIG_BLOCK, [])


@HAS_SLURM
def test_slurm_that_is_not_here_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(UserError, match="sbatch"), workers(1, "slurm"):
        pass
