"""Tests of callbacks, trackers and Trainer options during a fit, including progress, checkpoints and Ctrl-C."""

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
from brushexp_losses.direction import Direction
from brushexp_policies.accuracy import Accuracy
from brushexp_policies.patches import Patches
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from lightning.pytorch.callbacks import EarlyStopping, LearningRateMonitor, ModelCheckpoint, Timer
from lightning.pytorch.loggers import CSVLogger
from omegaconf import OmegaConf
from painters import assert_resumes, error_of, painter_of, take
from painters import fit as fit_painter
from refusals import refuses
from scenes import Windowed
from torch.testing import assert_close

from brushexp.errors import UserError
from brushexp.painting.components import Stage
from brushexp.pictures.similarity import psnr_of
from brushexp.plugins.density.adaptive import Adaptive
from brushexp.plugins.logger.base import Logger, Run
from brushexp.plugins.loss.perceptual import Perceptual
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.runs.tracking import Trackers, make_trackers
from brushexp.runs.trainer import make_trainer
from brushexp.system.callbacks import TimedCheckpoint
from brushexp.system.status import Status


class Line(L.LightningModule):
    """A module that fits its only weight to 1 and calls ``beside`` in each step."""

    def __init__(self, steps=8, beside=lambda step: None):
        super().__init__()
        self.weight = torch.nn.Parameter(torch.zeros(1))
        self.steps, self.beside, self.stop = steps, beside, None

    title = "drawing a line"

    @property
    def progress(self):
        return self.global_step / self.steps

    def state_line(self):
        return f"weight {self.weight.item():.2f}"

    def train_dataloader(self):
        return iter(lambda: 0, 1)  # endless

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


def test_a_fit_tells_where_it_stands_leaves_a_checkpoint_and_takes_options_of_the_trainer_alone(tmp_path, caplog):
    caplog.set_level("INFO")
    saved = []
    module = Line(beside=lambda step: saved.append((tmp_path / "checkpoint.ckpt").exists()))
    trainer = fit(tmp_path, module, every=0)
    assert trainer.global_step == 8
    assert saved == [False, *[True] * 7]
    assert (tmp_path / "checkpoint.ckpt").exists(), "until the task has written its results"
    assert "drawing a line: 100 %, weight 0.83, 0:00:00 left" in caplog.text
    refuses(r"trainer: .*speed", fit, tmp_path, Line(), speed=9)


def test_ctrl_c_ends_cleanly_and_the_fit_continues_exactly(tmp_path):
    straight = Line()
    fit(tmp_path, straight)
    first = Line(beside=lambda step: step == 3 and signal.raise_signal(signal.SIGINT))
    assert fit(tmp_path, first).global_step == 4
    assert first.stop == Status.INTERRUPTED
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    second = Line()
    trainer = fit(tmp_path, second, resume=tmp_path / "checkpoint.ckpt")
    assert trainer.global_step == 8
    assert second.stop is None
    assert torch.equal(second.weight, straight.weight)
    with pytest.raises(ZeroDivisionError):
        fit(tmp_path, Line(beside=lambda step: 1 / 0))
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


class Noting(Logger):
    """A logger that records its calls and raises an error in the call named ``fails``."""

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
    expected = [f"logger=noting failed: ValueError: {fails}; the run continues without it"] * bool(fails)
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


@pytest.mark.parametrize("options", [{"max_epochs": 1}, {"max_epochs": 9}, {"max_steps": 99}, {"max_epochs": -1}])
def test_a_fit_takes_the_steps_of_a_bare_loop_and_ends_with_the_plan(options):
    one, two = painter_of(steps=5), painter_of(steps=5)
    take(one, 5)
    trainer = fit_painter(two, **options)
    assert (trainer.global_step, trainer.current_epoch) == (5, 1)
    assert_close(dict(one.strokes().items()), dict(two.strokes().items()), rtol=0, atol=0)


ENDS = {
    "completed": ({}, [], 26, None),
    "max_steps": ({"max_steps": 13}, [], 13, "max_steps reached"),
    "max_epochs": ({"max_epochs": 2}, [], 20, "max_epochs reached"),
    "max_time": ({"max_time": {"seconds": 0}}, [], 0, "max_time reached"),
    "timer": ({}, [Timer({"seconds": 0}, verbose=False)], 0, "max_time reached"),
    "no_gain": ({}, [EarlyStopping("psnr", mode="max", min_delta=100, patience=1)], 20, "stopped early"),
    "threshold": ({}, [EarlyStopping("loss/mse", stopping_threshold=1.0)], 10, "stopped early"),
}


@pytest.mark.parametrize("end", ENDS)
def test_what_ends_a_fit_before_its_plan_is_told(end, tmp_path, monkeypatch):
    monkeypatch.setattr("brushexp.painting.painting_module.STEPS_PER_EPOCH", 10)
    options, callbacks, steps, status = ENDS[end]
    painter = painter_of(steps=26)
    trainer = fit_painter(painter, [*callbacks, TimedCheckpoint(tmp_path / "it.ckpt", None)], **options)
    assert (trainer.global_step, painter.stop) == (steps, status)


class Watch(L.Callback):
    """A callback that stores each step's PSNR tensor, and the values of PSNR and loss at that time."""

    def __init__(self):
        self.kept, self.then = [], []

    def on_train_batch_end(self, trainer, painter, *_):
        self.kept.append(trainer.callback_metrics["psnr"])
        self.then.append((float(trainer.callback_metrics["psnr"]), float(trainer.callback_metrics["loss/mse"])))


@pytest.mark.parametrize("plan", ["whole", "patches", "coarse"])
def test_callbacks_see_the_values_of_the_step(plan, tmp_path):
    best = {"monitor": "psnr", "mode": "max", "save_top_k": -1, "every_n_train_steps": 8}
    saved, watch = ModelCheckpoint(tmp_path, filename="{step}-{psnr:.3f}", **best), Watch()
    fit_painter(PLANS[plan](), [watch, saved])
    psnrs, errors = zip(*watch.then, strict=True)
    assert len(set(psnrs)) > 12
    assert [float(value) for value in watch.kept] == list(psnrs), "whenever they look"
    if plan == "whole":
        assert psnrs == pytest.approx([psnr_of(error) for error in errors], abs=1e-3)
    names = {f"step={step}-psnr={psnrs[step - 1]:.3f}.ckpt" for step in (8, 16, 24)}
    assert {path.name for path in tmp_path.iterdir()} == names


def test_callbacks_loggers_and_profilers_of_lightning_work(tmp_path):
    timer, rates = Timer(), LearningRateMonitor("step")
    logger = CSVLogger(tmp_path, name="", version="curves")
    painter = painter_of(Stage("a", Analytic(), 20), Stage("b", Analytic(), 10))
    trainer = fit_painter(painter, [timer, rates], logger=logger, log_every_n_steps=1, profiler="simple")
    assert trainer.global_step == 30
    assert timer.time_elapsed("train") > 0
    assert {"optimizer_step", "[Strategy]SingleDeviceStrategy.training_step"} <= set(
        trainer.profiler.recorded_durations
    )
    rows = (tmp_path / "curves" / "metrics.csv").read_text().splitlines()
    assert {"loss/mse", "psnr", "step", "seconds", "lr-Adam"} <= set(rows[0].split(","))


@pytest.mark.parametrize("precision", ["bf16-mixed", "32-true", "64-true"])
def test_precisions_of_lightning_work(precision):
    painter = painter_of(steps=20)
    before = error_of(painter)
    fit_painter(painter, precision=precision)
    assert painter.draw_whole().dtype == (torch.float64 if precision == "64-true" else torch.float32)
    assert error_of(painter) < before


PLANS = {
    "whole": lambda: painter_of(steps=24, order=Accuracy(every=3)),
    "patches": lambda: painter_of(steps=24, sampler=Patches(n_active=9, n_ring=5, patch=30), order=Accuracy(every=3)),
    "adaptive": lambda: painter_of(steps=24, n=40, density=Adaptive(), options={"budget": 60}),
    "stages": lambda: painter_of(Stage("a", Analytic(), 11), Stage("b", Analytic(soft=2.0), 13)),
    "coarse": lambda: painter_of(steps=24, options={"coarse": 0.5}),
    "losses": lambda: painter_of(steps=24, losses={"perceptual": Perceptual(), "direction": Direction(every=5)}),
    "warm-up": lambda: painter_of(Stage("fast", Analytic(), 11), Stage("slow", Windowed(), 13), order=Accuracy()),
}


# In the middle and at the end of an epoch.
@pytest.mark.parametrize(("plan", "steps"), [*((plan, 11) for plan in PLANS), ("whole", 14), ("patches", 14)])
def test_a_resumed_fit_ends_as_an_uninterrupted_one(plan, steps, tmp_path, monkeypatch):
    monkeypatch.setattr("brushexp.painting.painting_module.STEPS_PER_EPOCH", 7)
    assert_resumes(PLANS[plan], steps, tmp_path)


@pytest.mark.filterwarnings("ignore:Checkpoint directory")
@pytest.mark.parametrize("options", [{"every_n_train_steps": 7}, {"every_n_epochs": 1}], ids=["step", "epoch"])
def test_a_fit_goes_on_from_the_end_of_an_epoch(options, tmp_path, monkeypatch):
    monkeypatch.setattr("brushexp.painting.painting_module.STEPS_PER_EPOCH", 7)
    straight, again = (painter_of(steps=24) for _ in range(2))
    kept = [ModelCheckpoint(tmp_path, filename="{step}", save_top_k=-1, **options) for _ in range(2)]
    whole = fit_painter(straight, kept[:1])
    watch = Watch()
    trainer = fit_painter(again, [watch, kept[1]], ckpt_path=tmp_path / "step=14.ckpt")
    assert len(watch.then) == 10
    assert (trainer.global_step, trainer.current_epoch) == (24, whole.current_epoch)
    assert_close(dict(straight.strokes().items()), dict(again.strokes().items()), rtol=0, atol=0)
