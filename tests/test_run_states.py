"""Runs that are started, killed, resumed, moved and damaged in any order: nothing is lost, and nothing lies.

``BRUSHEXP_STATES=30 pytest tests/test_run_states.py`` tries so many histories of each way to paint; a default run
three, of which the first is empty.
"""

import json
import os
import shutil
import signal
import tempfile
from functools import partial
from pathlib import Path
from typing import ClassVar

import numpy as np
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

from brushexp.plugins.export.job import export_job
from brushexp.runs.run_folder import left_in
from brushexp.strokes.storage import load_catalogue
from brushexp.system.files import TEMPORARY

pytestmark = pytest.mark.slow
HISTORIES = int(os.environ.get("BRUSHEXP_STATES", "3"))
STEPS, FRAMES = 8, 3
SETTINGS = ["resolution=24", "threads=1", "report=false", "checkpoint_every=0"]
PICTURE = [*SETTINGS, "image=photo.png", "frames=2", "timelapse=gif", f"steps={STEPS}"]
WAYS = {  # to paint: what is typed
    "gradient": [*PICTURE, "strokes=9"],
    "oil": [*PICTURE, "look=oil", "strokes=30"],
    "hertzmann": [*PICTURE, "painter=hertzmann", "strokes=30"],  # which has no checkpoints
    "film": [*SETTINGS, "image=clip.mp4", "strokes=30", "steps=3", "film.steps=2"],
}
NAMES = ["a", "b"]
MOMENTS = [("checkpoint.ckpt", k, after) for k in (1, 2) for after in (False, True)]
MOMENTS += [(name, 1, after) for name in ("painting.png", "catalogue.h5", "metrics.json") for after in (False, True)]
MOMENTS += [("target.png", 1, True), ("timelapse.gif", 1, False)]
OF_FILMS = [(name, 1, after) for name in ("checkpoint.ckpt", "000000.h5", "000001.h5") for after in (False, True)]
OF_FILMS += [("film.mp4", 1, False), ("film.mp4", 1, True), ("preview.png", 1, True), ("metrics.json", 1, False)]


class Runs(RuleBasedStateMachine):
    """Two folders for runs, a picture, and a note of the user's own in each folder; what is expected is kept beside."""

    whole: ClassVar = {}  # way and target (a film's first strokes) -> strokes that every run ends with, killed or not

    begun: ClassVar[list[str]] = []  # words of the runs, of all histories

    def __init__(self, way: str) -> None:
        super().__init__()
        self.way, self.words, self.is_film = way, WAYS[way], way == "film"

    def ended(self, *words, **disturbed):
        Runs.begun.append(words)
        return ended(self.place, *words, **disturbed)

    def moment_of(self, data):
        return data.draw(st.none() | st.sampled_from(OF_FILMS if self.is_film else MOMENTS))

    @initialize()
    def begin(self):
        self.place = Path(tempfile.mkdtemp()).resolve()
        self.notes, self.damaged, self.is_changed = set(), set(), True
        self.change_picture()

    def teardown(self):
        shutil.rmtree(self.place, ignore_errors=True)

    def step_of(self, name):
        """The step that the checkpoint of a folder goes on from; None without a good one."""
        path = self.place / name / "checkpoint.ckpt"
        if not path.exists() or name in self.damaged:
            return None
        known = torch.load(path, weights_only=True)
        return len(list((self.place / name / "frames").glob("*.h5"))) if self.is_film else known["global_step"]

    def has_result(self, name):
        path = self.place / name / "metrics.json"
        return path.exists() and json.loads(path.read_text())["status"] != "failed"

    @rule(data=st.data(), name=st.sampled_from(NAMES), overwrite=st.booleans())
    def start(self, data, name, overwrite):
        kill = self.moment_of(data)
        holds = self.has_result(name) or (self.place / name / "checkpoint.ckpt").exists()
        words = [*self.words, f"output={name}", *["overwrite=true"] * overwrite]
        before = files_of(self.place / name)
        code, said = self.ended(*words, kill=kill)
        if holds and not overwrite:
            assert code == 1
            assert f"output={name} holds a run already" in said
            assert files_of(self.place / name) == before, "not a byte of it is another"
        else:
            self.damaged.discard(name)
            self.check_end(name, code, said, kill)

    @precondition(lambda self: any(self.step_of(name) is not None for name in NAMES))
    @rule(data=st.data(), into=st.sampled_from([*NAMES, None]))
    def resume(self, data, into):
        kill = self.moment_of(data)
        name = data.draw(st.sampled_from([name for name in NAMES if self.step_of(name) is not None]))
        into = into or name
        holds = into != name and (self.has_result(into) or (self.place / into / "checkpoint.ckpt").exists())
        code, said = self.ended(f"resume={name}", f"output={into}", kill=kill)
        if holds:
            assert code == 1
            assert f"output={into} holds a run already" in said
        elif "is not the file that the run began with; put it back" in said:
            assert code == 1
            assert self.step_of(name) is not None
        else:
            self.check_end(into, code, said, kill)

    @precondition(lambda self: self.way != "hertzmann")
    @rule(name=st.sampled_from(NAMES))
    def interrupt(self, name):
        if self.has_result(name) or (self.place / name / "checkpoint.ckpt").exists():
            return
        kill = ("000001.h5", 1, True) if self.is_film else ("checkpoint.ckpt", 2, True)
        code, said = self.ended(*self.words, f"output={name}", kill=kill, sent=signal.SIGTERM)
        assert code == 128 + signal.SIGTERM, said
        assert json.loads((self.place / name / "metrics.json").read_text())["status"] == "interrupted"

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
        """The folders change their names."""
        for old, new in (("a", "c"), ("b", "a"), ("c", "b")):
            if (self.place / old).exists():
                (self.place / old).rename(self.place / new)
        self.notes, self.damaged = (
            {{"a": "b", "b": "a"}[name] for name in names} for names in (self.notes, self.damaged)
        )

    @rule(name=st.sampled_from(NAMES))
    def note(self, name):
        if (self.place / name).exists():
            (self.place / name / "notes.txt").write_text("mine")
            self.notes.add(name)

    @precondition(lambda self: any(self.step_of(name) is not None for name in NAMES))
    @rule(data=st.data(), share=st.floats(0, 0.99))
    def damage(self, data, share):
        name = data.draw(st.sampled_from([name for name in NAMES if self.step_of(name) is not None]))
        path = self.place / name / "checkpoint.ckpt"
        path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
        self.damaged.add(name)
        code, said = self.ended(f"resume={name}", f"output={name}")
        assert code == 1
        assert "start anew" in said
        assert "Traceback" not in said

    def check_end(self, name, code, said, kill):
        """A run that could begin has ended as it should have."""
        folder = self.place / name
        assert "Traceback" not in said, said
        if kill is not None and code == -signal.SIGKILL:
            assert kill[0] != "checkpoint.ckpt" or kill[1:] == (1, False) or self.step_of(name) is not None, "lost"
            return
        assert code == 0, said
        assert not (folder / "checkpoint.ckpt").exists()
        assert not list(folder.rglob(TEMPORARY))
        assert self.has_result(name)
        unknown = {path for path in folder.rglob("*") if path.is_file()} - set(left_in(folder))
        assert {path.name for path in unknown} <= {"lock", "others.txt", "notes.txt"}, "overwrite=true would leave it"

    @invariant()
    def nothing_lies(self):
        for name in NAMES:
            folder = self.place / name
            assert name not in self.notes or (folder / "notes.txt").read_text() == "mine"
            if not (folder / "metrics.json").exists():
                continue
            metrics = json.loads((folder / "metrics.json").read_text())
            done, end = (metrics["n_frames"], FRAMES) if self.is_film else (metrics["steps"], STEPS)
            whole = done == end or self.way == "hertzmann"  # whose steps are its own
            assert (metrics["status"], whole) in (("completed", True), ("interrupted", False))
            assert whole or name in self.damaged or self.step_of(name) >= done
            if self.is_film:
                assert len(decoded(folder / "film.mp4")[0]) == done
                strokes = [load_catalogue(folder / "frames" / f"{k:06d}.h5").strokes for k in range(done)]
            else:
                strokes = [self.strokes_of(folder)]
            if whole:
                of = strokes[0].position.numpy().tobytes() if self.is_film else (folder / "target.png").read_bytes()
                for one, other in zip(strokes, Runs.whole.setdefault((self.way, of), strokes), strict=True):
                    assert all(torch.equal(value, getattr(other, field)) for field, value in one.items())

    def strokes_of(self, folder):
        """Of a painting, which is what they look like."""
        saved = load_catalogue(folder / "catalogue.h5")
        job = export_job(saved)
        drawn = np.concatenate([band.permute(1, 2, 0).numpy() for _, band in job.bands()]) * 255
        with Image.open(folder / "painting.png") as painting:
            assert np.abs(drawn - np.asarray(painting)).max() < 1.01, "the painting is that of the catalogue"
        return saved.strokes


def files_of(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in folder.rglob("*") if path.is_file() and path.name != "lock"}


@pytest.mark.parametrize("way", WAYS)
def test_nothing_is_lost_and_nothing_lies(way):
    if way == "film":
        pytest.importorskip("av")
    steps = 25 if HISTORIES > 3 else 12
    few = settings(max_examples=HISTORIES, stateful_step_count=steps, deadline=None)
    checks = settings(few, suppress_health_check=list(HealthCheck))
    Runs.begun.clear()
    run_state_machine_as_test(partial(Runs, way), settings=checks)
    assert Runs.begun, "hypothesis has tried nothing"
