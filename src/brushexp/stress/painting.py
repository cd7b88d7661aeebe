"""Cells of many steps: strokes that are optimised under extreme conditions, and what becomes of them."""

from dataclasses import dataclass

import lightning as L
import torch
from torch import Tensor

from brushexp.errors import UserError
from brushexp.painting.components import Stage, standard_components
from brushexp.painting.metrics import psnr_of
from brushexp.painting.painter import Painter
from brushexp.plugins.blend.base import Blend
from brushexp.plugins.optimizer.torch_optim import TorchOptim
from brushexp.plugins.renderer.base import Renderer
from brushexp.stress.check import DTYPES, Check, DrawnScene, compare, range_fault
from brushexp.stress.reference import CRASHES, Reference, check_of_error
from brushexp.stress.scenes import BACKGROUND, TARGETS, StressScene, random_strokes, random_target
from brushexp.strokes.catalogue import Catalogue

CANVAS, STROKES, FEW = (16, 25), 8, 3  # strokes; and of a renderer that is slow
USUAL = 0.02  # learning rate
SHORT, LONG = 30, 10_000  # steps
LEAST = 10  # of these, if a step takes ever so long


@dataclass(frozen=True)
class Exercise:
    """What strokes are put through.

    Attributes:
        target: (3, H, W).
        steps: gradient steps.
        rate: learning rate of Adam.
    """

    target: Tensor
    steps: int = SHORT
    rate: float = USUAL


def exercises() -> dict[str, Exercise]:
    """All of them."""
    return {
        "learning rate x 100": Exercise(random_target(CANVAS), 2 * SHORT, 100 * USUAL),
        "10,000 steps": Exercise(random_target(CANVAS), LONG),
        **{name: Exercise(target(CANVAS)) for name, target in TARGETS.items()},
    }


def check_painting(
    name: str, renderer: Renderer, blend: Blend, dtype: str, exercise: Exercise, patience: float
) -> Check:
    """Optimise a few strokes, and check what they are in the end: finite, in range, and painted as in float64.

    Args:
        name: of the renderer.
        renderer: draws the strokes.
        blend: lays them over each other.
        dtype: precision of the strokes.
        exercise: what they are put through.
        patience: seconds that 10,000 steps may take, and ten times what fewer may; if they would take longer, not all
            are taken, but those that fit into a tenth of it.
    """
    kind = DTYPES[dtype]
    if kind is torch.float64:
        renderer = Reference(renderer, StressScene(random_strokes(0, CANVAS), exercise.target, 0)).renderer
    try:
        painter = painter_of(name, renderer, blend, kind, exercise)
        before = psnr_of(float((painter.drawn() - painter.picture.target).square().mean()))
        take_steps(painter, patience if exercise.steps >= LONG else 0.1 * patience)
        picture = painter.drawn()
        strokes = painter.catalogue().map(Tensor.detach)
        reference = Reference(
            renderer, StressScene(strokes, exercise.target, len(strokes), painter.depth.front_to_back)
        )
        exact = reference.by(blend, dtype)
    except (UserError, *CRASHES) as error:
        return check_of_error(error)
    after = psnr_of(float((picture - painter.picture.target).square().mean()))
    fewer = f"{painter.schedule.step} of {exercise.steps:,} steps, " if painter.schedule.step < exercise.steps else ""
    drawn = DrawnScene(picture, {}, fault=range_fault(strokes))
    return compare(dtype, drawn, exact, strokes, f"{fewer}{before:.1f} to {after:.1f} dB")


def painter_of(name: str, renderer: Renderer, blend: Blend, dtype: torch.dtype, exercise: Exercise) -> Painter:
    """What optimises the strokes of an exercise."""
    components = standard_components(
        stages=[Stage(name, renderer, exercise.steps)], blend=blend, optimizer=TorchOptim(lr=exercise.rate)
    )
    strokes = random_strokes(STROKES if renderer.warm_up is None else FEW, CANVAS).map(lambda value: value.to(dtype))
    catalogue = Catalogue(strokes, components.optimizer.units)
    return Painter(catalogue, components, exercise.target.to(dtype), torch.tensor(BACKGROUND).to(dtype), seed=0)


def take_steps(painter: Painter, patience: float) -> None:
    """Take all steps if they fit into ``patience`` seconds, else those that fit into a tenth of it."""
    L.Trainer(
        accelerator="cpu",
        max_epochs=1,
        logger=False,
        callbacks=[Patience(patience)],
        enable_checkpointing=False,
        enable_progress_bar=False,
        enable_model_summary=False,
    ).fit(painter)


class Patience(L.Callback):
    """Ends the fit after ``limit`` seconds, or a tenth of them once it is clear that all steps will not fit."""

    def __init__(self, limit: float) -> None:
        self.limit = limit

    def on_train_batch_end(self, trainer: L.Trainer, pl_module: L.LightningModule, *_: object) -> None:
        assert isinstance(pl_module, Painter)
        schedule = pl_module.schedule
        if schedule.step == LEAST and schedule.seconds / schedule.step * schedule.steps > self.limit:
            self.limit *= 0.1
        if schedule.step >= LEAST and schedule.seconds > self.limit:
            trainer.should_stop = True
