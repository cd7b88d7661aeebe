"""Simulations, sweeps and exports that are killed leave nothing half-written, and go on to the same bits.

By default every fifth kill is tried; all of them: ``BRUSHEXP_KILLS=all pytest tests/test_kills.py``. Single runs are
killed in test_run_states.py.
"""

import json
import os
import re
import signal

import pytest
from program import ended
from sweeps import read_csv

from brushexp.strokes.storage import load_catalogue
from brushexp.system.files import TEMPORARY

pytestmark = pytest.mark.slow
PAINT = ["image=chelsea", "resolution=32", "strokes=12", "threads=1", "frames=3", "timelapse=gif", "checkpoint_every=0"]
SET = ["task=simulate", "engine=disc", "engine.window=64", "threads=1", "n=640"]
SHARDS = {"SHARD_STROKES": 32, "BATCH_STROKES": 16}
SET_KILLS = [*9 * [(".h5", 1, True), (".h5", 2, False)], ("strokes.png", 1, False), ("metrics.json", 1, False)]
SWEPT = ("target.png", "checkpoint.ckpt", "painting.png", "catalogue.h5", "metrics.json")
SWEEP_KILLS = [(f"{job}/{name}", 1, after) for job in (0, 1) for name in SWEPT for after in (False, True)]
EXPORTED = ["painting.png", "strokes.svg", "strokes.json", "strokes.csv", "process.gif", "relief.png", "height.png"]
EXPORTED += ["normals.png"]
EXPORT_KILLS = [(name, 1, after) for after in (False, True) for name in (*EXPORTED, "metrics.json")]


def some(kills):
    """Those that are tried, each with a signal and the exit code that it gives: at least the first and the last."""
    kills = kills if os.environ.get("BRUSHEXP_KILLS") == "all" else [*kills[:-1:5], kills[-1]]
    signals = ((signal.SIGTERM, 128 + signal.SIGTERM), (signal.SIGKILL, -signal.SIGKILL))
    return [(kill, *signals[number % 2]) for number, kill in enumerate(kills)]


def test_a_simulation_that_is_killed_goes_on_to_the_same_bits(tmp_path):
    assert ended(tmp_path, *SET, "output=set", **SHARDS)[0] == 0
    for kill, _, _ in some(SET_KILLS):
        assert ended(tmp_path, *SET, "output=sim", kill=kill, **SHARDS)[0] == -signal.SIGKILL, kill
    code, output = ended(tmp_path, *SET, "output=sim", **SHARDS)
    assert code == 0, output
    assert "640 of 640 strokes are there already" in output
    made, whole = (
        {path.name: path.read_bytes() for path in (tmp_path / name / "strokes").glob("*.h5")} for name in ("sim", "set")
    )
    assert made == whole
    assert not list((tmp_path / "sim").rglob(TEMPORARY))


def test_a_sweep_that_is_killed_keeps_the_jobs_that_are_done_and_goes_on_to_the_same_bits(tmp_path):
    words = ["-m", "look=plain", *PAINT, "steps=5,6,7", "report=false", "finish_steps=${steps}"]
    sweep, finished = tmp_path / "s", {}
    assert ended(tmp_path, *words, "output=whole")[0] == 0
    words.append("output=s")
    for number, (kill, sent, expected) in enumerate(some(SWEEP_KILLS)):
        job = int(kill[0][0])
        code, output = ended(tmp_path, *words, *["resume=sweep"] * bool(number), kill=kill, sent=sent)
        assert code == expected, (kill, output)
        statuses = [json.loads(path.read_text())["status"] for path in sorted(sweep.glob("*/metrics.json"))]
        assert statuses[:job] == job * ["completed"], kill
        assert set(statuses[job:]) <= {"interrupted", "at work"}, kill
        if sent == signal.SIGTERM:
            assert statuses[job:] == ["interrupted"], kill
            assert [row["status"] for row in read_csv(sweep / "table.csv")] == statuses
            assert not list(sweep.rglob(TEMPORARY)), kill
        for done in range(job):
            times = {str(path): path.stat().st_mtime_ns for path in (sweep / str(done)).rglob("*") if path.is_file()}
            assert finished.setdefault(done, times) == times, kill
    for more, message in (
        ([], "output=s holds a run already"),
        (
            ["resume=sweep", "seed=3"],
            r"job 0 was '.*' and would be '.* seed=3'; type: .* -m .*=5,6,7 .*=\$\{steps\}' .*resume=sweep",
        ),
        (["resume=sweep", "output=t"], "output=t holds no sweep"),
    ):
        refused, output = ended(tmp_path, *words, *more)
        assert refused == 1
        assert re.search(message, output), output
        assert output.count("\n") == 1, output
    code, output = ended(tmp_path, *words, "resume=sweep")
    assert code == 0, output
    assert not [*sweep.rglob(TEMPORARY), *sweep.rglob("checkpoint.ckpt")]
    assert [row["status"] for row in read_csv(sweep / "table.csv")] == 3 * ["completed"]
    assert "resume" not in (sweep / "table.csv").read_text()
    for job in "012":
        for name in ("painting.png", "strokes.svg"):
            assert (sweep / job / name).read_bytes() == (tmp_path / "whole" / job / name).read_bytes()
        load_catalogue(sweep / job / "catalogue.h5")


def test_an_export_leaves_no_half_file_wherever_it_is_killed(tmp_path):
    assert ended(tmp_path, *PAINT, "steps=2", "report=false", "output=a")[0] == 0
    words = ["task=export", "catalogue=a/catalogue.h5", "to=png,svg,json,csv,process,relief", "to.process.format=gif"]
    words += ["to.process.seconds=1", "threads=1"]
    code, output = ended(tmp_path, *words, "output=straight")
    assert code == 0, output
    whole = {name: (tmp_path / "straight" / name).read_bytes() for name in EXPORTED}
    for kill, sent, expected in [*some(EXPORT_KILLS), (None, 0, 0)]:
        code, output = ended(tmp_path, *words, "output=b", "overwrite=true", kill=kill, sent=sent)
        assert code == expected, (kill, output)
        assert len(list((tmp_path / "b").glob(TEMPORARY))) <= (sent == signal.SIGKILL), kill
        files = {path.name: path.read_bytes() for path in (tmp_path / "b").iterdir() if path.name in whole}
        assert files.items() <= whole.items(), kill
        assert (tmp_path / "b" / "metrics.json").exists() == (kill in (None, ("metrics.json", 1, True))), kill
