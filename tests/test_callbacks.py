"""Callbacks of every fit and trackers of a run: progress, checkpoints, Ctrl-C, and nothing that stops it."""

import logging
import math
import signal
import tempfile
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import lightning as L
import pytest
import torch
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from lightning.pytorch.loggers import CSVLogger
from omegaconf import OmegaConf

from brushexp.errors import UserError
from brushexp.plugins.logger.base import Logger, Run
from brushexp.runs.tracking import Trackers, make_trackers
from brushexp.runs.trainer import make_trainer
from brushexp.system.callbacks import INTERRUPTED


class Line(L.LightningModule):
    """One weight that is drawn to 1; a step takes what ``beside`` does."""

    def __init__(self, steps=8, beside=lambda step: None):
        super().__init__()
        self.weight = torch.nn.Parameter(torch.zeros(1))
        self.steps, self.beside, self.stop = steps, beside, ""

    title = "drawing a line"

    @property
    def progress(self):
        return self.global_step / self.steps

    def state_line(self):
        return f"weight {self.weight.item():.2f}"

    def train_dataloader(self):
        return iter(lambda: 0, 1)  # without end

    def training_step(self, batch, batch_idx):
        self.beside(batch_idx)
        loss = (self.weight - 1).square().sum()
        self.log("psnr", -loss)
        return loss

    def configure_optimizers(self):
        return torch.optim.SGD(self.parameters(), lr=0.1)

    def on_train_batch_end(self, *_):
        self.trainer.should_stop |= self.progress >= 1


def fit(folder, module, *, chosen=(), resume=None, every=None, callbacks=(), **trainer):
    options = {"enable_progress_bar": False, "max_epochs": 1, "enable_model_summary": False, "log_every_n_steps": 1}
    cfg = {"task": "paint", "callbacks": dict(chosen), "trainer": options | trainer, "checkpoint_every": every}
    logger = CSVLogger(tempfile.mkdtemp(dir=folder), name="", version="")
    made = make_trainer(OmegaConf.create(cfg), torch.device("cpu"), folder, [logger], callbacks)
    made.fit(module, ckpt_path=resume)
    return made


def test_a_fit_tells_where_it_stands_and_leaves_a_checkpoint(tmp_path, caplog):
    caplog.set_level("INFO")
    saved = []
    module = Line(beside=lambda step: saved.append((tmp_path / "checkpoint.ckpt").exists()))
    trainer = fit(tmp_path, module, every=0)
    assert trainer.global_step == 8
    assert saved == [False, *[True] * 7]
    assert (tmp_path / "checkpoint.ckpt").exists(), "until the task has written its results"
    assert "drawing a line: 100 %, weight 0.83, 0:00:00 left" in caplog.text


def test_ctrl_c_ends_cleanly_and_the_fit_continues_exactly(tmp_path):
    straight = Line()
    fit(tmp_path, straight)
    first = Line(beside=lambda step: step == 3 and signal.raise_signal(signal.SIGINT))
    assert fit(tmp_path, first).global_step == 4
    assert first.stop == INTERRUPTED
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    second = Line()
    trainer = fit(tmp_path, second, resume=tmp_path / "checkpoint.ckpt")
    assert trainer.global_step == 8
    assert second.stop == ""
    assert torch.equal(second.weight, straight.weight)
    with pytest.raises(ZeroDivisionError):
        fit(tmp_path, Line(beside=lambda step: 1 / 0))
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_an_unknown_option_of_the_trainer_is_refused(tmp_path):
    with pytest.raises(UserError, match=r"trainer: .*speed"):
        fit(tmp_path, Line(), speed=9)


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
