"""Cells of many steps: strokes that are optimised under extreme conditions, and what becomes of them."""

from copy import deepcopy
from dataclasses import dataclass
from datetime import timedelta
from typing import Any

import lightning as L
import torch
from lightning.pytorch.callbacks import Timer
from torch import Tensor

from brushexp.errors import UserError
from brushexp.painting.components import Stage, standard_components
from brushexp.painting.painter import Painter
from brushexp.plugins.blend.base import Blend
from brushexp.plugins.optimizer.torch_optim import TorchOptim
from brushexp.plugins.renderer.base import Renderer
from brushexp.stress.check import CRASHES, DTYPES, Check, DrawnScene, check_of_error, compare, draw_scene, range_fault
from brushexp.stress.scenes import BACKGROUND, TARGETS, StressScene, random_strokes, random_target
from brushexp.strokes.catalogue import Catalogue

CANVAS, STROKES, FEW = (16, 25), 8, 3  # strokes; and of a renderer that is slow
USUAL = 0.02  # learning rate


@dataclass(frozen=True)
class Exercise:
    """What strokes are put through: a target (3, H, W), gradient steps, and the learning rate of Adam."""

    target: Tensor
    steps: int = 30
    rate: float = USUAL


EXERCISES = {
    "learning rate x 100": Exercise(random_target(CANVAS), 60, 100 * USUAL),
    "10,000 steps": Exercise(random_target(CANVAS), 10_000),
    **{name: Exercise(target(CANVAS)) for name, target in TARGETS.items()},
}


def check_painting(
    name: str, renderer: Renderer, exercise: Exercise, patience: float, blend: Blend, dtype: str
) -> Check:
    """Optimise a few strokes, and check what they are in the end: finite, in range, and painted as in float64.

    After ``patience`` seconds no further step is taken.
    """
    precise = deepcopy(renderer).double()
    try:
        painter = painter_of(name, precise if dtype == "float64" else renderer, blend, DTYPES[dtype], exercise)
        quiet: dict[str, Any] = {"logger": False, "enable_checkpointing": False, "enable_progress_bar": False}
        timer = Timer(timedelta(seconds=patience), verbose=False)
        L.Trainer(accelerator="cpu", max_epochs=1, callbacks=[timer], enable_model_summary=False, **quiet).fit(painter)
        picture = painter.drawn()
        strokes = painter.catalogue().map(Tensor.detach)
        scene = StressScene(strokes, exercise.target, len(strokes), painter.depth.front_to_back)
        exact = draw_scene(precise, blend, scene, strokes.map(Tensor.double))
    except (UserError, *CRASHES) as error:
        return check_of_error(error)
    taken = painter.schedule.step
    note = f"{taken} of {exercise.steps:,} steps" if taken < exercise.steps else ""
    return compare(dtype, DrawnScene(picture, {}, fault=range_fault(strokes)), exact, strokes, note)


def painter_of(name: str, renderer: Renderer, blend: Blend, dtype: torch.dtype, exercise: Exercise) -> Painter:
    """What optimises the strokes of an exercise."""
    components = standard_components(
        stages=[Stage(name, renderer, exercise.steps)], blend=blend, optimizer=TorchOptim(lr=exercise.rate)
    )
    strokes = random_strokes(STROKES if renderer.warm_up is None else FEW, CANVAS).map(lambda value: value.to(dtype))
    catalogue = Catalogue(strokes, components.optimizer.units)
    return Painter(catalogue, components, exercise.target.to(dtype), torch.tensor(BACKGROUND).to(dtype), seed=0)
