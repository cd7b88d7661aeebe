"""Painters are LightningModules: every option and callback of Lightning's Trainer does what its manual says."""

import lightning as L
import pytest
import torch
from brushexp_losses.direction import Direction
from brushexp_losses.perceptual import Perceptual
from brushexp_policies.accuracy import Accuracy
from brushexp_policies.patches import Patches
from lightning.pytorch.callbacks import EarlyStopping, LearningRateMonitor, ModelCheckpoint, Timer
from lightning.pytorch.loggers import CSVLogger
from painters import assert_resumes, error_of, fit, painter_of, take
from scenes import Windowed
from torch.testing import assert_close

from brushexp.painting import painting_module
from brushexp.painting.components import Stage
from brushexp.pictures.similarity import psnr_of
from brushexp.plugins.density.adaptive import Adaptive
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.system.callbacks import TimedCheckpoint


@pytest.mark.parametrize("options", [{"max_epochs": 1}, {"max_epochs": 9}, {"max_steps": 99}, {"max_epochs": -1}])
def test_a_fit_takes_the_steps_of_a_bare_loop_and_ends_with_the_plan(options):
    one, two = painter_of(steps=5), painter_of(steps=5)
    take(one, 5)
    trainer = fit(two, **options)
    assert (trainer.global_step, trainer.current_epoch) == (5, 1)
    assert_close(dict(one.strokes().items()), dict(two.strokes().items()), rtol=0, atol=0)


ENDS = {
    "completed": ({}, [], 26, ""),
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
    trainer = fit(painter, [*callbacks, TimedCheckpoint(tmp_path / "it.ckpt", None)], **options)
    assert (trainer.global_step, painter.stop) == (steps, status)


class Watch(L.Callback):
    """Keeps what a callback may look at after each step, and what it was then."""

    def __init__(self):
        self.kept, self.then = [], []

    def on_train_batch_end(self, trainer, painter, *_):
        self.kept.append(trainer.callback_metrics["psnr"])
        self.then.append((float(trainer.logged_metrics["psnr"]), float(trainer.callback_metrics["loss/mse"])))


@pytest.mark.parametrize("plan", ["whole", "patches", "coarse"])
def test_callbacks_see_the_values_of_the_step(plan, tmp_path):
    best = {"monitor": "psnr", "mode": "max", "save_top_k": -1, "every_n_train_steps": 8}
    saved, watch = ModelCheckpoint(tmp_path, filename="{step}-{psnr:.3f}", **best), Watch()
    fit(PLANS[plan](), [watch, saved])
    psnrs, errors = zip(*watch.then, strict=True)
    assert len(set(psnrs)) > 12
    assert [float(value) for value in watch.kept] == list(psnrs), "whenever they look"
    if plan == "whole":
        assert psnrs == pytest.approx([psnr_of(error) for error in errors], abs=1e-3)
    names = {f"step={step}-psnr={psnrs[step - 1]:.3f}.ckpt" for step in (8, 16, 24)}
    assert {path.name for path in tmp_path.iterdir()} == names


def test_values_are_computed_only_for_who_looks(monkeypatch):
    looks = []
    monkeypatch.setattr(painting_module, "psnr_of", lambda error: looks.append(error) or 0.0)
    fit(painter_of(steps=30), log_every_n_steps=100)
    assert len(looks) <= 5, "at the first step and at the end"


def test_callbacks_and_loggers_of_lightning_work(tmp_path):
    timer, rates = Timer(), LearningRateMonitor("step")
    logger = CSVLogger(tmp_path, name="", version="curves")
    painter = painter_of(Stage("a", Analytic(), 20), Stage("b", Analytic(), 10))
    trainer = fit(painter, [timer, rates], logger=logger, log_every_n_steps=1, profiler="simple")
    assert trainer.global_step == 30
    assert timer.time_elapsed("train") > 0
    assert "[LightningModule]StrokeOptimizer.optimizer_step" in trainer.profiler.summary()
    rows = (tmp_path / "curves" / "metrics.csv").read_text().splitlines()
    assert {"loss/mse", "psnr", "step", "seconds", "lr-Adam"} <= set(rows[0].split(","))


@pytest.mark.parametrize("precision", ["bf16-mixed", "32-true", "64-true"])
def test_precisions_of_lightning_work(precision):
    painter = painter_of(steps=20)
    before = error_of(painter)
    fit(painter, precision=precision)
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


# In the middle of an epoch, and at the end of one.
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
    whole = fit(straight, kept[:1])
    watch = Watch()
    trainer = fit(again, [watch, kept[1]], ckpt_path=tmp_path / "step=14.ckpt")
    assert len(watch.then) == 10
    assert (trainer.global_step, trainer.current_epoch) == (24, whole.current_epoch)
    assert_close(dict(straight.strokes().items()), dict(again.strokes().items()), rtol=0, atol=0)
