"""Helpers that make painters and take their steps, with or without a Trainer."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import lightning as L
import torch
from lightning.pytorch.callbacks import Checkpoint
from scenes import random_strokes
from torch.testing import assert_close

from brushexp.painting.components import Stage, standard_components
from brushexp.painting.stroke_optimizer import StrokeOptimizer
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.sampler.base import View
from brushexp.strokes.catalogue import Catalogue
from brushexp.strokes.prior import clamp_to_prior

SIZE = (48, 70)
BACKGROUND = torch.tensor([0.2, 0.5, 0.9])
QUIET = {
    **{"logger": False, "enable_checkpointing": False, "enable_progress_bar": False, "enable_model_summary": False},
    **{"accelerator": "cpu", "max_epochs": -1},
}  # options of a Trainer


def painter_of(
    *stages: Stage, n=60, target=None, size=SIZE, strokes=None, steps=1000, renderer=None, options=None, **parts
):
    """Make a painter with ``n`` random strokes from the range of the prior.

    ``parts`` are components, and ``options`` are arguments of `StrokeOptimizer`.
    """
    torch.manual_seed(5)
    stages = list(stages) or [Stage("it", renderer or Analytic(), steps)]
    components = standard_components(**{"stages": stages, "blend": Tiled(opaque=0), **parts})
    strokes = clamp_to_prior(random_strokes(n, size)) if strokes is None else strokes
    target = torch.rand(3, *size) if target is None else target
    catalogue = Catalogue(strokes, components.optimizer.units)
    return StrokeOptimizer(catalogue, components, target, BACKGROUND, seed=0, **(options or {}))


def take(painter: StrokeOptimizer, steps: int, loop: Any = None) -> Any:
    """Take steps in a bare loop, without a Trainer; pass the result as ``loop`` to continue."""
    if loop is None:
        loop = painter.configure_optimizers()
        painter.prepare()
    for _ in range(steps):
        painter.take_step(loop["optimizer"])
        loop["lr_scheduler"].step()
    return loop


def fit(painter: StrokeOptimizer, callbacks=(), ckpt_path=None, **options: Any) -> L.Trainer:
    """Fit a painter with a Trainer, as a user of Lightning would."""
    options = {"enable_checkpointing": any(isinstance(one, Checkpoint) for one in callbacks)} | options
    trainer = L.Trainer(**{**QUIET, **options}, callbacks=list(callbacks))
    trainer.fit(painter, ckpt_path=ckpt_path)
    return trainer


def assert_resumes(make: Callable[[], StrokeOptimizer], steps: int, folder: Path) -> None:
    """Assert that a fit that is interrupted after ``steps`` steps and resumed ends like an uninterrupted fit."""
    straight, first, second = (make() for _ in range(3))
    fit(straight)
    fit(first, max_steps=steps).save_checkpoint(folder / "it.ckpt")
    assert fit(second, ckpt_path=folder / "it.ckpt").global_step == straight.schedule.steps
    assert_close(dict(straight.strokes().items()), dict(second.strokes().items()), rtol=0, atol=0)
    assert torch.equal(straight.visits, second.visits)
    assert straight.evaluations == second.evaluations


def error_of(painter: StrokeOptimizer) -> float:
    """Return the mean squared error of the current painting."""
    return float((painter.draw_whole() - painter.picture.target).square().mean())


def gradient_of(painter: StrokeOptimizer, view: View, part: Catalogue | None = None) -> dict[str, torch.Tensor]:
    """Return the gradient of a view's loss with respect to the strokes of ``part``, or all strokes if it is None."""
    moving = painter.catalogue if part is None else part
    moving.zero_grad()
    painter.loss(view, moving()).backward()
    return {name: value.grad for name, value in moving.named_parameters()}
