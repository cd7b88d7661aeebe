"""Tests that runs lose nothing and report the truth when started, killed, interrupted, resumed and moved in any order.

``BRUSHEXP_STATES=30 pytest tests/test_run_states.py`` tries 30 histories of each kind of run. The default is three, and
the first one is empty. All completed runs of a kind match bit for bit. The kill points of a sweep lie just before and
after it writes a file; it is killed at every seventh of them, or at all of them if ``BRUSHEXP_KILLS=all``.
"""

import json
import os
import re
import shutil
import signal
import tempfile
from functools import partial
from pathlib import Path
from typing import ClassVar

import pytest
import torch
from films import decoded, encoded, scene
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)
from PIL import Image
from program import ended
from sweeps import read_csv

from brushexp.strokes.storage import load_catalogue
from brushexp.system.files import TEMPORARY
from brushexp.system.run_files import files_written

pytestmark = pytest.mark.slow
HISTORIES = int(os.environ.get("BRUSHEXP_STATES", "3"))
STEPS, FRAMES = 8, 3
SETTINGS = ["threads=1", "checkpoint_every=0"]
PICTURE = [*SETTINGS, "image=photo.png", "resolution=24", "report=false", "frames=2", "timelapse=gif", f"steps={STEPS}"]
TRAIN = [*SETTINGS, "task=train", "batch_size=8"]
WAYS = {  # words of the commands
    "gradient": [*PICTURE, "strokes=9"],
    "oil": [*PICTURE, "look=oil", "strokes=30"],
    "hertzmann": [*PICTURE, "painter=hertzmann", "strokes=30"],  # has no checkpoints
    "film": [*SETTINGS, "image=clip.mp4", "resolution=24", "report=false", "strokes=30", "steps=3", "film.steps=2"],
    "training": [
        *(*TRAIN, "epochs=3", "minutes=null", "limit=64", "fid=0", "critic=true", "critic_width=4"),
        *("renderer.width=4", "renderer.dense=16", "renderer.code=2"),
    ],
    "discriminator": [*SETTINGS, "task=train_discriminator", "batch_size=8", "trainer.max_steps=20", "epochs=null"],
}
ENDS = {"gradient": STEPS, "oil": STEPS, "film": FRAMES}  # progress of a complete run; others have their own counts
WEIGHTS = {"training": "neural.safetensors", "discriminator": "discriminator.safetensors"}
FILES = {  # files of a run, before or after which it is killed
    "film": ("checkpoint.ckpt", "000000.h5", "000001.h5", "film.mp4", "preview.png", "metrics.json"),
    "training": ("checkpoint.ckpt", "neural.safetensors", "neural.json", "validation.png", "metrics.json"),
    "discriminator": ("checkpoint.ckpt", "discriminator.safetensors", "discriminator.json", "metrics.json"),
}
OF_PAINTINGS = ("checkpoint.ckpt", "target.png", "painting.png", "catalogue.h5", "metrics.json", "timelapse.gif")
NAMES = ["a", "b"]


class Runs(RuleBasedStateMachine):
    """Two run folders, a picture and the user's own notes, along with their expected state."""

    whole: ClassVar = {}  # kind and target -> the bits of every complete run, killed or not
    begun: ClassVar[list[str]] = []  # words of the runs in all histories

    def __init__(self, way: str, strokes: Path) -> None:
        super().__init__()
        self.way, self.words, self.is_film = way, WAYS[way], way == "film"
        self.words = [*self.words, *([f"data={strokes}"] if way == "training" else [])]
        self.task = [word for word in self.words if word.startswith("task=")]

    def ended(self, *words, **disturbed):
        Runs.begun.append(words)
        return ended(self.place, *words, **disturbed)

    def kill_of(self, data):
        files = st.sampled_from(FILES.get(self.way, OF_PAINTINGS))
        return data.draw(st.none() | st.tuples(files, st.sampled_from([1, 1, 2]), st.booleans()))

    @initialize()
    def begin(self):
        self.place, self.notes, self.is_changed = Path(tempfile.mkdtemp()).resolve(), set(), True
        self.change_picture()

    def teardown(self):
        shutil.rmtree(self.place, ignore_errors=True)

    def step_of(self, name):
        """Return the step at which a folder's run would resume, or None if the folder has no checkpoint."""
        path = self.place / name / "checkpoint.ckpt"
        if not path.exists():
            return None
        if self.is_film:
            return len(list((self.place / name / "frames").glob("*.h5")))
        return torch.load(path, weights_only=True)["global_step"]

    def metrics_of(self, name):
        path = self.place / name / "metrics.json"
        return json.loads(path.read_text()) if path.exists() else {}

    def is_held(self, name):
        return bool(self.metrics_of(name)) or (self.place / name / "checkpoint.ckpt").exists()

    @rule(data=st.data(), name=st.sampled_from(NAMES), overwrite=st.booleans())
    def start(self, data, name, overwrite):
        kill, before, is_refused = self.kill_of(data), files_of(self.place / name), self.is_held(name) and not overwrite
        code, output = self.ended(*self.words, f"output={name}", *["overwrite=true"] * overwrite, kill=kill)
        if is_refused:
            assert code == 1
            assert f"output={name} already holds a run" in output
            assert files_of(self.place / name) == before, "not a byte of it is another"
        else:
            self.check_end(name, code, output, kill)

    @precondition(lambda self: any(self.step_of(name) is not None for name in NAMES))
    @rule(data=st.data(), other=st.booleans())
    def resume(self, data, other):
        kill = self.kill_of(data)
        name = data.draw(st.sampled_from([name for name in NAMES if self.step_of(name) is not None]))
        into = NAMES[1 - NAMES.index(name)] if other else name
        step, is_refused = self.step_of(name), other and self.is_held(into)
        code, output = self.ended(*self.task, f"resume={name}", f"output={into}", kill=kill)
        if is_refused or "has changed since the run began; restore it" in output:
            assert code == 1
            assert not is_refused or f"output={into} already holds a run" in output
            assert self.step_of(name) == step
        else:
            self.check_end(into, code, output, kill)
            assert self.done_in(into) in (None, *range(step, 99)), "it goes on, and does not begin anew"

    @precondition(lambda self: self.way != "hertzmann")
    @rule(name=st.sampled_from(NAMES), sent=st.sampled_from([signal.SIGINT, signal.SIGTERM, signal.SIGHUP]))
    def interrupt(self, name, sent):
        if self.is_held(name):
            return
        kill = ("000001.h5", 1, True) if self.is_film else ("checkpoint.ckpt", 2, True)
        code, output = self.ended(*self.words, f"output={name}", kill=kill, sent=sent)
        assert code == 128 + sent, output
        assert f"continue with: brushexp {' '.join([*self.task, ''])}resume=" in output
        assert self.metrics_of(name)["status"] == "interrupted"

    @precondition(lambda self: self.way not in WEIGHTS)
    @rule()
    def change_picture(self):
        self.is_changed = not self.is_changed
        if self.is_film:
            encoded(self.place / "clip.mp4", [255 * self.is_changed ^ picture for picture in scene(FRAMES, side=32)])
            return
        with Image.radial_gradient("L") if self.is_changed else Image.linear_gradient("L") as picture:
            picture.convert("RGB").resize((40, 30)).save(self.place / "photo.png")

    @rule()
    def move(self):
        """Swap the names of the two run folders."""
        for old, new in (("a", "c"), ("b", "a"), ("c", "b")):
            if (self.place / old).exists():
                (self.place / old).rename(self.place / new)
        self.notes = {{"a": "b", "b": "a"}[name] for name in self.notes}

    @rule(name=st.sampled_from(NAMES))
    def note(self, name):
        if (self.place / name).exists():
            (self.place / name / "notes.txt").write_text("mine")
            self.notes.add(name)

    def check_end(self, name, code, output, kill):
        """Assert that a run that was allowed to start has ended correctly."""
        folder = self.place / name
        assert "Traceback" not in output, output
        if kill is not None and code == -signal.SIGKILL:
            assert kill[0] != "checkpoint.ckpt" or kill[1:] == (1, False) or self.step_of(name) is not None, "lost"
            return
        assert code == 0, output
        assert self.metrics_of(name)["status"] == "completed"
        assert not (folder / "checkpoint.ckpt").exists()
        assert not list(folder.rglob(TEMPORARY))
        unknown = {path for path in folder.rglob("*") if path.is_file()} - set(files_written(folder))
        assert {path.name for path in unknown} <= {"lock", "files.txt", "notes.txt"}, "overwrite=true would leave it"
        if (folder / "curves").exists():
            steps = [int(row["step"]) for row in read_csv(folder / "curves" / "metrics.csv")]
            assert steps == sorted(steps)

    def done_in(self, name):
        return self.metrics_of(name).get("n_frames" if self.is_film else "steps")

    @invariant()
    def nothing_lies(self):
        for name in NAMES:
            folder, metrics = self.place / name, self.metrics_of(name)
            assert name not in self.notes or (folder / "notes.txt").read_text() == "mine"
            if not metrics:
                continue
            status, done = metrics["status"], self.done_in(name)
            assert status in ("completed", "at work", "interrupted")
            assert self.way not in ENDS or (done == ENDS[self.way]) == (status != "interrupted")
            assert status != "interrupted" or self.step_of(name) >= done
            if self.is_film:
                assert len(decoded(folder / "film.mp4")[0]) == done
            if status != "interrupted":
                bits = self.bits_of(folder)
                of = bits[0] if self.way in (*WEIGHTS, "film") else (folder / "target.png").read_bytes()
                assert Runs.whole.setdefault((self.way, of), bits) == bits

    def bits_of(self, folder):
        if self.way in WEIGHTS:
            return [b"", (folder / WEIGHTS[self.way]).read_bytes()]
        catalogues = sorted((folder / "frames").glob("*.h5")) if self.is_film else [folder / "catalogue.h5"]
        strokes = [load_catalogue(path).strokes for path in catalogues]
        return [value.numpy().tobytes() for one in strokes for _, value in one.items()]


def files_of(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in folder.rglob("*") if path.is_file() and path.name != "lock"}


@pytest.fixture(scope="module")
def strokes(tmp_path_factory) -> Path:
    """Simulate a training set of strokes, and return its folder."""
    folder = tmp_path_factory.mktemp("set").resolve()
    code, output = ended(folder, "task=simulate", "engine=disc", "engine.window=64", "threads=1", "n=160", "output=set")
    assert code == 0, output
    return folder / "set" / "strokes"


@pytest.mark.parametrize("way", WAYS)
def test_nothing_is_lost_and_nothing_lies(way, strokes):
    if way == "film":
        pytest.importorskip("av")
    few = settings(max_examples=HISTORIES, stateful_step_count=25 if HISTORIES > 3 else 12, deadline=None)
    checks = settings(few, suppress_health_check=list(HealthCheck))
    Runs.begun.clear()
    run_state_machine_as_test(partial(Runs, way, strokes), settings=checks)
    assert Runs.begun, "hypothesis has tried nothing"


SWEEP = ["-m", "look=plain", *SETTINGS, "image=chelsea", "resolution=32", "strokes=12", "frames=3", "timelapse=gif"]
SWEEP += ["steps=5,6", "report=false", "finish_steps=${steps}"]
MOVED = [(f"{job}/{name}", 1, after) for job in (0, 1) for name in OF_PAINTINGS[:-1] for after in (False, True)]


def kills_of_a_sweep():
    """List the kills to try, including the first and the last, each with its signal and the expected exit code."""
    kills = MOVED if os.environ.get("BRUSHEXP_KILLS") == "all" else [*MOVED[:-1:7], MOVED[-1]]
    signals = ((signal.SIGTERM, 128 + signal.SIGTERM), (signal.SIGKILL, -signal.SIGKILL))
    return [(kill, *signals[number % 2]) for number, kill in enumerate(kills)]


def test_a_sweep_that_is_killed_keeps_the_jobs_that_are_done_and_goes_on_to_the_same_bits(tmp_path):
    sweep, words, finished = tmp_path / "s", [*SWEEP, "output=s"], {}
    assert ended(tmp_path, *SWEEP, "output=whole")[0] == 0
    for number, (kill, sent, expected) in enumerate(kills_of_a_sweep()):
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
        (
            ["resume=sweep", "seed=3"],
            r"job 0 was '.*' and would be '.* seed=3'; type: .* -m .*=5,6 .*=\$\{steps\}' .*resume=sweep",
        ),
        (["resume=sweep", "output=t"], "output=t does not hold a sweep"),
    ):
        refused, output = ended(tmp_path, *words, *more)
        assert refused == 1
        assert re.search(message, output), output
        assert output.count("\n") == 1, output
    code, output = ended(tmp_path, *words, "resume=sweep")
    assert code == 0, output
    assert not [*sweep.rglob(TEMPORARY), *sweep.rglob("checkpoint.ckpt")]
    assert [row["status"] for row in read_csv(sweep / "table.csv")] == 2 * ["completed"]
    assert "resume" not in (sweep / "table.csv").read_text()
    for job in "01":
        for name in ("painting.png", "strokes.svg"):
            assert (sweep / job / name).read_bytes() == (tmp_path / "whole" / job / name).read_bytes()
        load_catalogue(sweep / job / "catalogue.h5")
