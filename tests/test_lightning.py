"""Painters are LightningModules: every option and callback of Lightning's Trainer does what its manual says."""

import math

import pytest
import torch
from lightning.pytorch.callbacks import LearningRateMonitor, ModelCheckpoint, Timer
from lightning.pytorch.loggers import CSVLogger
from painters import assert_resumes, error_of, fit, painter_of, take
from torch.testing import assert_close

from brushexp.painting.components import Stage
from brushexp.plugins.density.adaptive import Adaptive
from brushexp.plugins.optimizer.torch_optim import TorchOptim
from brushexp.plugins.order.orders import Accuracy
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.sampler.patches import Patches
from brushexp.plugins.sampler.whole import Whole

LBFGS = {"name": "LBFGS", "lr": 0.5, "options": {"max_iter": 3}}


@pytest.mark.parametrize("optimizer", [{}, LBFGS])
@pytest.mark.parametrize("sampler", [Whole, Patches])
def test_max_steps_takes_exactly_as_many_steps(sampler, optimizer):
    painter = painter_of(sampler=sampler(), optimizer=TorchOptim(**optimizer))
    before = error_of(painter)
    trainer = fit(painter, max_steps=7)
    assert trainer.global_step == painter.schedule.step == 7
    assert error_of(painter) < before


@pytest.mark.parametrize("options", [{"max_epochs": 1}, {"max_epochs": 9}, {"max_steps": 99}, {"max_epochs": -1}])
def test_a_fit_takes_the_steps_of_a_bare_loop_and_ends_with_the_plan_which_is_one_epoch(options):
    one, two = painter_of(steps=5), painter_of(steps=5)
    take(one, 5)
    trainer = fit(two, **options)
    assert (trainer.global_step, trainer.current_epoch) == (5, 1)
    assert_close(dict(one.strokes().items()), dict(two.strokes().items()), rtol=0, atol=0)


def test_callbacks_and_loggers_of_lightning_work(tmp_path):
    checkpoints = ModelCheckpoint(tmp_path / "models", monitor="psnr", mode="max", save_top_k=1, every_n_train_steps=5)
    timer, rates = Timer(), LearningRateMonitor("step")
    logger = CSVLogger(tmp_path, name="", version="curves")
    painter = painter_of(Stage("a", Analytic(), 20), Stage("b", Analytic(), 10))
    trainer = fit(
        painter, [checkpoints, timer, rates], logger=logger, enable_checkpointing=True, log_every_n_steps=1,
        profiler="simple",
    )  # fmt: skip
    assert trainer.global_step == 30
    assert checkpoints.best_model_path
    assert timer.time_elapsed("train") > 0
    assert "[LightningModule]Painter.optimizer_step" in trainer.profiler.summary()
    rows = (tmp_path / "curves" / "metrics.csv").read_text().splitlines()
    columns = rows[0].split(",")
    assert {"loss/mse", "psnr", "step", "seconds", "lr-Adam"} <= set(columns)
    lr = [float(row.split(",")[columns.index("lr-Adam")] or "nan") for row in rows[1:]]
    lr = [rate for rate in lr if not math.isnan(rate)]
    assert lr[0] == pytest.approx(0.02)
    assert min(lr[:20]) < 0.004
    assert max(lr[20:]) == pytest.approx(0.02), "stages restart the schedule"


@pytest.mark.parametrize("precision", ["bf16-mixed", "32-true", "64-true"])
def test_precisions_of_lightning_work(precision):
    painter = painter_of(steps=20)
    before = error_of(painter)
    fit(painter, precision=precision)
    assert painter.drawn().dtype == (torch.float64 if precision == "64-true" else torch.float32)
    assert error_of(painter) < before


PLANS = {
    "whole": lambda: painter_of(steps=24, order=Accuracy(every=3)),
    "patches": lambda: painter_of(steps=24, sampler=Patches(n_active=9, n_ring=5, patch=30), order=Accuracy(every=3)),
    "adaptive": lambda: painter_of(steps=24, n=40, density=Adaptive(), options={"budget": 60}),
    "stages": lambda: painter_of(Stage("a", Analytic(), 11), Stage("b", Analytic(soft=2.0), 13)),
    "coarse": lambda: painter_of(steps=24, options={"coarse": 0.5}),
}


@pytest.mark.parametrize("steps", [11, 14])
@pytest.mark.parametrize("plan", PLANS)
def test_a_resumed_fit_ends_as_an_uninterrupted_one(plan, steps, tmp_path):
    assert_resumes(PLANS[plan], steps, tmp_path)
