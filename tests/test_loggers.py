"""Trackers of a run: none of them can stop it, and all are told how it ended."""

import logging
import math
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import pytest
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode

from brushexp.errors import UserError
from brushexp.plugins.logger.base import Logger, Run
from brushexp.runs.tracking import Trackers, make_trackers


class Noting(Logger):
    """Notes what it is told, and fails where it should."""

    def __init__(self, fails: str = "") -> None:
        self.fails, self.calls = fails, []

    def open(self, run):
        self.tell("open")
        return self

    def log_metrics(self, metrics, step):
        self.tell("curve")

    def save(self):
        self.tell("save")

    def finish(self, run):
        self.end = run
        self.tell("finish")

    def finalize(self, status):
        self.tell(status)

    def tell(self, word: str) -> None:
        self.calls.append(word)
        if word == self.fails:
            raise ValueError(word)


def carried_out(tracker: Logger, error: BaseException | None = None) -> None:
    with Trackers({"noting": tracker}, Run(Path("x"))) as trackers:
        for step in range(2):
            trackers.log_metrics({"a": 1.0}, step)
            trackers.save()
        trackers.report({"psnr": 20.0, "ssim": math.inf, "status": "completed", "anytime": [[1.0, 20.0]]})
        if error is not None:
            raise error


@pytest.mark.parametrize(("fails", "calls"), [
    ("", "open curve save curve save finish success"),
    ("open", "open finish"),
    ("curve", "open curve finish success"),
    ("save", "open curve save finish success"),
    ("finish", "open curve save curve save finish success"),
    ("success", "open curve save curve save finish success"),
])  # fmt: skip
def test_a_tracker_that_failed_takes_no_more_curves_but_is_told_of_the_end(fails, calls, caplog):
    tracker = Noting(fails)
    carried_out(tracker)
    assert tracker.calls == calls.split()
    expected = [f"logger=noting stopped: ValueError: {fails}; the run goes on without it"] * bool(fails)
    assert [record.message for record in caplog.records if record.levelno == logging.WARNING] == expected


@pytest.mark.parametrize(("error", "status"), [
    (None, "completed"),
    (KeyboardInterrupt(), "interrupted"),
    (SystemExit(1), "interrupted"),
    (UserError("x"), "failed"),
])  # fmt: skip
def test_trackers_are_told_how_the_run_ended(error, status):
    tracker = Noting()
    with nullcontext() if error is None else pytest.raises(type(error)):
        carried_out(tracker, error)
    assert tracker.end.status == status
    assert tracker.end.numbers == {"psnr": 20.0}
    assert set(tracker.end.row) == {"psnr", "ssim", "status"}


def test_a_part_of_a_run_has_a_name_of_its_own(config, monkeypatch):
    words = ["seed=1", "+x=[1,2]", "~logger.csv", "output=a/sweep"]
    hydra = SimpleNamespace(runtime=SimpleNamespace(output_dir="a/sweep/3"), overrides=SimpleNamespace(task=words))
    hydra.mode = RunMode.MULTIRUN
    monkeypatch.setattr(HydraConfig, "initialized", lambda: True)
    monkeypatch.setattr(HydraConfig, "get", lambda: hydra)
    run = make_trackers(config(), Path("a/sweep/3/ratio_25")).run
    assert (run.name, run.group, run.chosen) == ("3/ratio_25", "sweep", {"seed": "1", "x": "[1,2]"})
