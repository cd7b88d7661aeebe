"""Runs that are killed go on to the same bits, wherever that was.

Each chain of kills is one run that is killed, continued (every third time in a new folder), killed again ... and at
last finished. By default a chain has every fifth of its kills; all twenty of each, in half an hour:
``BRUSHEXP_KILLS=all pytest tests/test_kills.py``.
"""

import json
import os
import re
import signal
from pathlib import Path

import pytest
import torch
from program import ended
from sweeps import read_csv

from brushexp.runs.run_folder import left_in
from brushexp.strokes.storage import load_catalogue
from brushexp.system.files import TEMPORARY

pytestmark = pytest.mark.slow
PAINT = ["image=chelsea", "resolution=32", "strokes=12", "threads=1", "frames=3", "timelapse=gif", "checkpoint_every=0"]
TRAIN = ["task=train", "data=set/strokes", "epochs=3", "minutes=null", "batch_size=8", "limit=64", "threads=1", "fid=0"]
TRAIN += ["checkpoint_every=0", "renderer.width=4", "renderer.dense=16", "renderer.code=2"]
CRITIC = ["task=train_discriminator", "trainer.max_steps=60", "epochs=null", "batch_size=8", "threads=1"]
CRITIC += ["checkpoint_every=0"]
SET = ["task=simulate", "engine=disc", "engine.window=64", "threads=1"]
SHARDS = {"SHARD_STROKES": 32, "BATCH_STROKES": 16}
CHECKPOINTS = [("checkpoint.ckpt", k, after) for k in (1, 2, 3) for after in (False, True)]
ENDS = {
    "paint": [
        *((name, 1, after) for name in ("painting.png", "catalogue.h5", "metrics.json") for after in (False, True)),
        *(("target.png", 1, True), ("strokes.svg", 1, False), ("timelapse.gif", 1, True), ("report.html", 1, True)),
    ],
    "train": [
        *((name, 1, after) for name in ("l.safetensors", "neural.json", "metrics.json") for after in (False, True)),
        *(("validation.png", 1, True), ("epoch_002.png", 1, False)),
    ],
    "critic": [
        *((f"discriminator.{kind}", 1, after) for kind in ("safetensors", "json") for after in (False, True)),
        *(("metrics.json", 1, after) for after in (False, True)),
    ],
}

SWEPT = ("target.png", "checkpoint.ckpt", "painting.png", "catalogue.h5", "metrics.json")
SWEEP_KILLS = [(f"{job}/{name}", 1, after) for job in (0, 1) for name in SWEPT for after in (False, True)]
EXPORTED = ["painting.png", "strokes.svg", "strokes.json", "strokes.csv", "process.gif", "relief.png", "height.png"]
EXPORTED += ["normals.png", "metrics.json"]
EXPORT_KILLS = [(name, 1, after) for after in (False, True) for name in (*EXPORTED[:-1], "process.gif", "metrics.json")]


def some(kills):
    """Those of a chain that are tried: at least what comes first and last."""
    return kills if os.environ.get("BRUSHEXP_KILLS") == "all" else [*kills[:-1:5], kills[-1]]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """With a set of strokes to learn from."""
    path = tmp_path_factory.mktemp("kills").resolve()
    assert ended(path, *SET, "n=640", "output=set", **SHARDS)[0] == 0
    return path


def steps_of(folder: Path) -> list[int]:
    """At which the curves have values, as they stand."""
    return [int(row["step"]) for row in read_csv(folder / "curves" / "metrics.csv")]


def assert_same_painting(one: Path, other: Path) -> None:
    """To the bit."""
    assert (one / "painting.png").read_bytes() == (other / "painting.png").read_bytes()
    theirs = load_catalogue(other / "catalogue.h5").strokes
    for field, value in load_catalogue(one / "catalogue.h5").strokes.items():
        assert torch.equal(value, getattr(theirs, field)), field


@pytest.mark.parametrize(("words", "result", "kills"), [
    ([*PAINT, "steps=40"], "catalogue.h5", [*2 * CHECKPOINTS[:4], *CHECKPOINTS[4:], *ENDS["paint"]]),
    ([*TRAIN, "critic=true", "critic_width=4"], "neural.safetensors", [*2 * CHECKPOINTS, *ENDS["train"]]),
    (CRITIC, "discriminator.safetensors", [*2 * CHECKPOINTS, *CHECKPOINTS[:2], *ENDS["critic"]]),
], ids=["painting", "training", "discriminator"])  # fmt: skip
def test_a_run_that_is_killed_goes_on_to_the_same_bits(folder, tmp_path, words, result, kills, request):
    name = request.node.callspec.id
    straight = folder / f"{name}-straight"
    code, said = ended(folder, *words, f"output={straight}")
    assert code == 0, said
    task = [word for word in words if word.startswith("task=")]
    signals = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)[: 3 if name == "painting" else 1]
    ends = [(CHECKPOINTS[1], sent, 128 + sent) for sent in signals]
    all_kills, taken = [*ends, *((kill, signal.SIGKILL, -signal.SIGKILL) for kill in some(kills))], 0
    for number, (kill, sent, wanted) in enumerate(all_kills):
        into = f"{name}-{number}" if number % 3 == 2 and words[-1].startswith("resume=") else name
        code, said = ended(folder, *words, f"output={into}", kill=kill, sent=sent)
        assert code == wanted, (kill, said)
        if sent != signal.SIGKILL:
            assert f"continue with: brushexp {' '.join([*task, ''])}resume=" in said
            noted = json.loads((folder / into / "metrics.json").read_text())
            assert noted["status"] == "interrupted"
            assert noted["steps"] > taken, "it goes on, and does not begin anew"
            taken = noted["steps"]
        if (folder / into / "checkpoint.ckpt").exists():
            name, words = into, [*task, f"resume={into}"]
    code, said = ended(folder, *words, f"output={name}")
    assert code == 0, said
    assert "not empty" not in said, "curves go on"
    killed = folder / name
    assert not (killed / "checkpoint.ckpt").exists()
    assert not list(killed.rglob(TEMPORARY))
    assert json.loads((killed / "metrics.json").read_text())["status"] == "completed"
    assert steps_of(killed) == sorted(steps_of(killed))
    unknown = {path for path in killed.rglob("*") if path.is_file()} - set(left_in(killed))
    assert {path.name for path in unknown} == {"lock", "others.txt"}, "overwrite=true would leave it there"
    if result != "catalogue.h5":
        assert (killed / result).read_bytes() == (straight / result).read_bytes()
        return
    assert_same_painting(killed, straight)


def test_a_simulation_that_is_killed_goes_on_to_the_same_bits(folder):
    kills = [*9 * [(".h5", 1, True), (".h5", 2, False)], ("strokes.png", 1, False), ("metrics.json", 1, False)]
    for kill in some(kills):
        assert ended(folder, *SET, "n=640", "output=sim", kill=kill, **SHARDS)[0] == -signal.SIGKILL, kill
    code, said = ended(folder, *SET, "n=640", "output=sim", **SHARDS)
    assert code == 0, said
    assert "640 of 640 strokes are there already" in said
    made, whole = (
        {path.name: path.read_bytes() for path in (folder / name / "strokes").glob("*.h5")} for name in ("sim", "set")
    )
    assert made == whole
    assert not list((folder / "sim").rglob(TEMPORARY))


def statuses(sweep: Path) -> list[str]:
    """By the table of a sweep."""
    return [row["status"] for row in read_csv(sweep / "table.csv")]


def written(folder: Path) -> dict[str, int]:
    """When each file below a folder was written."""
    return {str(path): path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}


def test_a_sweep_that_is_killed_keeps_the_jobs_that_are_done_and_goes_on_to_the_same_bits(tmp_path):
    words = ["-m", "look=plain", *PAINT, "steps=5,6,7", "report=false", "finish_steps=${steps}"]
    sweep, kept = tmp_path / "s", {}
    assert ended(tmp_path, *words, "output=whole")[0] == 0
    words.append("output=s")
    for number, kill in enumerate(some(SWEEP_KILLS)):
        job = int(kill[0][0])
        sent = (signal.SIGTERM, signal.SIGKILL)[(number + job) % 2]
        code, said = ended(tmp_path, *words, *["resume=sweep"] * bool(number), kill=kill, sent=sent)
        assert code == (143 if sent == signal.SIGTERM else -9), (kill, said)
        assert sent == signal.SIGKILL or not list(sweep.rglob(TEMPORARY)), kill
        noted = [json.loads(path.read_text())["status"] for path in sorted(sweep.glob("*/result.json"))]
        assert noted[:job] == job * ["completed"], kill
        assert noted[job:] in [["interrupted"], []][: 2 if sent == signal.SIGKILL else 1], kill
        assert sent == signal.SIGKILL or statuses(sweep) == noted
        for path in sweep.rglob("catalogue.h5"):
            load_catalogue(path)
        for done in range(job):
            assert kept.setdefault(done, written(sweep / str(done))) == written(sweep / str(done)), kill
    for more, message in (
        ([], "output=s holds a run already"),
        (
            ["resume=sweep", "seed=3"],
            r"job 0 was '.*' and would be '.* seed=3'; type: .* -m .*=5,6,7 .*=\$\{steps\}' .*resume=sweep",
        ),
        (["resume=sweep", "output=t"], "output=t holds no sweep"),
    ):
        refused, said = ended(tmp_path, *words, *more)
        assert refused == 1
        assert re.search(message, said), said
        assert said.count("\n") == 1, said
    code, said = ended(tmp_path, *words, "resume=sweep")
    assert code == 0, said
    assert not list(sweep.rglob(TEMPORARY))
    assert not list(sweep.rglob("checkpoint.ckpt"))
    assert statuses(sweep) == 3 * ["completed"]
    assert "resume" not in (sweep / "table.csv").read_text()
    for job, steps in zip("012", (5, 6, 7), strict=True):
        assert steps_of(sweep / job)[-1] == steps - 1
        assert_same_painting(sweep / job, tmp_path / "whole" / job)


def test_an_export_leaves_no_half_file_wherever_it_is_killed(tmp_path):
    assert ended(tmp_path, *PAINT, "steps=2", "report=false", "output=a")[0] == 0
    words = ["task=export", "catalogue=a/catalogue.h5", "to=png,svg,json,csv,process,relief", "to.process.format=gif"]
    words += ["to.process.seconds=1", "threads=1"]
    code, said = ended(tmp_path, *words, "output=straight")
    assert code == 0, said
    whole = {name: (tmp_path / "straight" / name).read_bytes() for name in EXPORTED[:-1]}
    for number, kill in enumerate(some(EXPORT_KILLS)):
        sent = (signal.SIGTERM, signal.SIGKILL)[number % 2]
        code, said = ended(tmp_path, *words, "output=b", "overwrite=true", kill=kill, sent=sent)
        assert code == (143 if sent == signal.SIGTERM else -9), (kill, said)
        left = list((tmp_path / "b").glob(TEMPORARY))
        assert len(left) <= (sent == signal.SIGKILL), kill
        there = {path.name: path.read_bytes() for path in (tmp_path / "b").iterdir() if path.name in whole}
        assert there.items() <= whole.items(), kill
        assert (tmp_path / "b" / "metrics.json").exists() == (kill == ("metrics.json", 1, True)), kill
    code, said = ended(tmp_path, *words, "output=b", "overwrite=true")
    assert code == 0, said
    assert not list((tmp_path / "b").glob(TEMPORARY))
