"""Runs that are started, killed, resumed, moved and damaged in any order: nothing is lost, and nothing lies.

``BRUSHEXP_STATES=30 pytest tests/test_run_states.py`` tries so many histories; a default run tries one.
"""

import json
import os
import shutil
import signal
import tempfile
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
import torch
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

from brushexp.painting.outputs import export_job, renderer_of
from brushexp.plugins.blend.tiled import Tiled
from brushexp.strokes.storage import load_catalogue
from brushexp.system.files import TEMPORARY

HISTORIES = int(os.environ.get("BRUSHEXP_STATES", "1"))
STEPS = 8
SETTINGS = ["image=photo.png", "resolution=24", "strokes=9", f"steps={STEPS}", "threads=1", "frames=2", "timelapse=gif"]
SETTINGS += ["report=false", "checkpoint_every=0"]
NAMES = ["a", "b"]
MOMENTS = [("checkpoint.ckpt", k, after) for k in (1, 2) for after in (False, True)]
MOMENTS += [(name, 1, after) for name in ("painting.png", "catalogue.h5", "metrics.json") for after in (False, True)]
MOMENTS += [("target.png", 1, True), ("timelapse.gif", 1, False)]


class Runs(RuleBasedStateMachine):
    """Two folders for runs, a picture, and a note of the user's own in each folder; what is expected is kept beside."""

    whole: ClassVar = {}  # target -> strokes that every run ends with, however often it was killed

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
        return (
            torch.load(path, weights_only=True)["global_step"] if path.exists() and name not in self.damaged else None
        )

    def has_result(self, name):
        path = self.place / name / "metrics.json"
        return path.exists() and json.loads(path.read_text())["status"] != "failed"

    @rule(name=st.sampled_from(NAMES), kill=st.none() | st.sampled_from(MOMENTS), overwrite=st.booleans())
    def start(self, name, kill, overwrite):
        holds = self.has_result(name) or (self.place / name / "checkpoint.ckpt").exists()
        words = [*SETTINGS, f"output={name}", *["overwrite=true"] * overwrite]
        before = files_of(self.place / name)
        code, said = ended(self.place, *words, kill=kill)
        if holds and not overwrite:
            assert code == 1
            assert f"output={name} holds a run already" in said
            assert files_of(self.place / name) == before, "not a byte of it is another"
        else:
            self.damaged.discard(name)
            self.check_end(name, code, said, kill)

    @precondition(lambda self: any(self.step_of(name) is not None for name in NAMES))
    @rule(data=st.data(), into=st.sampled_from([*NAMES, None]), kill=st.none() | st.sampled_from(MOMENTS))
    def resume(self, data, into, kill):
        name = data.draw(st.sampled_from([name for name in NAMES if self.step_of(name) is not None]))
        into = into or name
        holds = into != name and (self.has_result(into) or (self.place / into / "checkpoint.ckpt").exists())
        code, said = ended(self.place, f"resume={name}", f"output={into}", kill=kill)
        if holds:
            assert code == 1
            assert f"output={into} holds a run already" in said
        elif "is not the file that the run began with; put it back" in said:
            assert code == 1
            assert self.step_of(name) is not None
        else:
            self.check_end(into, code, said, kill)

    @rule(name=st.sampled_from(NAMES))
    def interrupt(self, name):
        if self.has_result(name) or (self.place / name / "checkpoint.ckpt").exists():
            return
        kill = ("checkpoint.ckpt", 2, True)
        code, said = ended(self.place, *SETTINGS, f"output={name}", kill=kill, sent=signal.SIGTERM)
        assert code == 128 + signal.SIGTERM, said
        assert json.loads((self.place / name / "metrics.json").read_text())["status"] == "interrupted"

    @rule()
    def change_picture(self):
        self.is_changed = not self.is_changed
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
        code, said = ended(self.place, f"resume={name}", f"output={name}")
        assert code == 1
        assert "start anew" in said
        assert "Traceback" not in said

    def check_end(self, name, code, said, kill):
        """A run that could begin has ended as it should have."""
        folder = self.place / name
        assert "Traceback" not in said, said
        if kill is not None and code == -signal.SIGKILL:
            assert kill[0] != "checkpoint.ckpt" or kill[1:] == (1, False) or self.step_of(name), "nothing is lost"
            return
        assert code == 0, said
        assert not (folder / "checkpoint.ckpt").exists()
        assert not list(folder.rglob(TEMPORARY))
        assert self.has_result(name)

    @invariant()
    def nothing_lies(self):
        for name in NAMES:
            folder = self.place / name
            assert name not in self.notes or (folder / "notes.txt").read_text() == "mine"
            if not (folder / "metrics.json").exists():
                continue
            metrics = json.loads((folder / "metrics.json").read_text())
            assert (metrics["status"], metrics["steps"] == STEPS) in (("completed", True), ("interrupted", False))
            saved = load_catalogue(folder / "catalogue.h5")
            job = export_job(saved, renderer_of(saved), Tiled(), saved.renderer)
            drawn = np.concatenate([band.permute(1, 2, 0).numpy() for _, band in job.bands()]) * 255
            with Image.open(folder / "painting.png") as painting:
                assert np.abs(drawn - np.asarray(painting)).max() < 1.01, "the painting is that of the catalogue"
            if metrics["status"] == "completed":
                whole = Runs.whole.setdefault((folder / "target.png").read_bytes(), saved.strokes)
                assert all(torch.equal(value, getattr(whole, field)) for field, value in saved.strokes.items())
            else:
                assert name in self.damaged or self.step_of(name) >= metrics["steps"]


def files_of(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in folder.rglob("*") if path.is_file() and path.name != "lock"}


@pytest.mark.slow
def test_nothing_is_lost_and_nothing_lies():
    few = settings(max_examples=HISTORIES, stateful_step_count=12 if HISTORIES == 1 else 25, deadline=None)
    run_state_machine_as_test(Runs, settings=settings(few, suppress_health_check=list(HealthCheck)))
