"""Cells of the matrix: a scene drawn forwards and backwards, or strokes optimised, in one precision against float64."""

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field, replace
from datetime import timedelta
from enum import Enum
from typing import Any

import lightning as L
import torch
from lightning.pytorch.callbacks import Timer
from torch import Tensor

from brushexp.compositing.layers import Layers
from brushexp.compositing.mixing import mixing
from brushexp.errors import UserError
from brushexp.painting.components import Stage, standard_components
from brushexp.painting.stroke_optimizer import StrokeOptimizer
from brushexp.plugins.blend.base import Blend, pixel_centres
from brushexp.plugins.blend.dense import Dense
from brushexp.plugins.optimizer.torch import TorchOptim
from brushexp.plugins.renderer.base import Renderer
from brushexp.registry import build_named
from brushexp.strokes.catalogue import FIELDS, PRECISE, Catalogue, Strokes, drawable
from brushexp_extremes.scenes import (
    BACKGROUND,
    SPACES,
    TARGETS,
    StressScene,
    one_bright_pixel,
    random_strokes,
    random_target,
)

DTYPES = {"float64": torch.float64, "float32": torch.float32, "bfloat16": torch.bfloat16, "float16": torch.float16}
# Largest difference of a pixel, in [0, 1]. Strokes of 16 bits are drawn in float32, so their pictures are as exact.
PICTURE_BOUNDS = {"float64": 1e-9, "float32": 1e-4, "bfloat16": 1e-4, "float16": 1e-4}
# Largest relative difference of a field's gradient, see `gradient_error`; of 16 bits, what rounding it once may cost.
GRADIENT_BOUNDS = {"float64": 1e-6, "float32": 1e-3, "bfloat16": 2**-8, "float16": 2**-9}
NEGLIGIBLE_SHARE = 1e-3  # of the sum of |dL/dI| over all pixels, below which a gradient moves nothing
PROBED_STROKES, PROBED_PIXELS = 64, 2000  # at which alpha is looked at, at most
CRASHES = (RuntimeError, TypeError, ValueError, LookupError, ArithmeticError, MemoryError, AssertionError)
CANVAS, STROKES, FEW = (16, 25), 8, 2  # strokes; and of a renderer that is slow
USUAL = 0.02  # learning rate


class Outcome(Enum):
    """What became of a scene."""

    exact = "exact"  # picture and gradient agree with float64 within the bounds
    degraded = "degraded"  # finite, but outside of them
    refused = "refused"  # with a message that a user can act on
    broken = "broken"  # NaN, Inf, an alpha or a picture outside [0, 1], or a crash


@dataclass(frozen=True)
class Check:
    """An outcome and its reasons.

    ``picture`` is the largest difference of a pixel from float64, ``gradient`` the largest relative difference of a
    gradient, None without one. ``note`` is a message, what is broken, or how many strokes or steps it was.
    """

    outcome: Outcome
    picture: float | None = None
    gradient: float | None = None
    note: str = ""


@dataclass(frozen=True)
class DrawnScene:
    """A picture (3, H, W), and the gradient of its mean squared error by field.

    ``pull`` is the sum of |dL/dI| over the picture, what a gradient is large or small against; ``fault`` is "" or what
    is already known to be broken.
    """

    image: Tensor
    gradient: dict[str, Tensor]
    pull: float = 0.0
    fault: str = ""


@dataclass(frozen=True)
class Exercise:
    """What strokes are put through: a target (3, H, W), gradient steps, and the learning rate of Adam.

    ``parts`` are other components than usual: family -> name and options. The strokes may come to ``growth`` times as
    many, ``focus`` (H, W), of mean 1, weighs the pixels, and ``color`` is the space in which the strokes mix.
    """

    target: Tensor
    steps: int = 30
    rate: float = USUAL
    parts: Mapping[str, tuple[str, dict[str, Any]]] = field(default_factory=dict)
    growth: int = 1
    focus: Tensor | None = None
    color: str = "rgb"


EXERCISES = {
    "learning rate x 100": Exercise(random_target(CANVAS), 60, 100 * USUAL),
    "1,000 steps": Exercise(random_target(CANVAS), 1000),
    "parts of the canvas": Exercise(
        random_target(CANVAS), parts={"sampler": ("patches", {"n_active": 2, "n_ring": 1, "patch": 9})}
    ),
    "strokes that come and go": Exercise(
        random_target(CANVAS), parts={"density": ("adaptive", {"rounds": 3, "moved": 0.5})}, growth=4
    ),
    "focus on one pixel": Exercise(random_target(CANVAS), focus=one_bright_pixel(CANVAS)[0] * CANVAS[0] * CANVAS[1]),
    **{f"mixing in {space}": Exercise(TARGETS["target 0"](CANVAS), color=space) for space in SPACES},
    **{name: Exercise(target(CANVAS)) for name, target in TARGETS.items()},
}


def draw_scene(renderer: Renderer, blend: Blend, scene: StressScene, strokes: Strokes) -> DrawnScene:
    """The picture of ``strokes`` on the canvas of a scene, and the gradient of its mean squared error."""
    strokes = strokes.map(lambda value: value.detach().clone().requires_grad_())
    layers = renderer(strokes)
    order = torch.arange(len(strokes)) if scene.order is None else scene.order
    image = in_space(blend, scene.color)(layers, order, scene.size, torch.tensor(BACKGROUND)).image
    error = image - scene.target.to(image)
    if image.requires_grad:
        error.square().mean().backward()
    gradient = {name: torch.zeros_like(v) if v.grad is None else v.grad for name, v in strokes.items()}
    pull = float(2 * error.detach().double().abs().mean())
    return DrawnScene(image.detach(), gradient, pull, _alpha_fault(layers, scene.size))


def in_space(blend: Blend, color: str) -> Blend:
    """The same blend in a colour space."""
    return mixing(blend, build_named("color", color, {}))


class Reference:
    """A scene in float64, each picture drawn once."""

    def __init__(self, renderer: Renderer, scene: StressScene) -> None:
        self.renderer = deepcopy(renderer).double()
        self.scene = scene
        self._drawn: dict[tuple[Blend | None, str], DrawnScene] = {}

    def by(self, blend: Blend | None, dtype: str) -> DrawnScene:
        """The strokes as ``dtype`` holds them, drawn in float64; None for every stroke at every pixel."""
        kind = DTYPES[dtype]
        held = "" if kind in PRECISE else dtype
        if (blend, held) not in self._drawn:
            strokes = drawable(self.scene.strokes.map(lambda value: value.to(kind) if held else value))
            strokes = strokes.map(Tensor.double)
            self._drawn[blend, held] = draw_scene(self.renderer, blend or Dense(), self.scene, strokes)
        return self._drawn[blend, held]


def check_drawing(renderer: Renderer, reference: Reference, blend: Blend, dtype: str) -> Check:
    """Check what a renderer and a blend make of a scene in one precision.

    In float64 against every stroke at every pixel (``blend=dense``): this says what a blend leaves out by design. In
    the others against the same blend in float64 and the same strokes as the precision holds them: this says what the
    arithmetic costs.
    """
    scene, strokes = reference.scene, reference.scene.strokes
    note = f"{len(strokes)} of {scene.wanted:,} strokes" if len(strokes) < scene.wanted else ""
    try:
        if dtype == "float64":
            return compare(dtype, reference.by(blend, dtype), reference.by(None, dtype), strokes, note)
        drawn = draw_scene(renderer, blend, scene, strokes.map(lambda value: value.to(DTYPES[dtype])))
        return compare(dtype, drawn, reference.by(blend, dtype), strokes, note)
    except (UserError, *CRASHES) as error:
        return check_of_error(error)


def check_painting(
    name: str, renderer: Renderer, exercise: Exercise, patience: float, blend: Blend, dtype: str
) -> Check:
    """Optimise a few strokes, and check what they are in the end: finite, in range, and painted as in float64.

    After ``patience`` seconds no further step is taken.
    """
    precise, kind = deepcopy(renderer).double(), DTYPES[dtype]
    stage = Stage(name, precise if dtype == "float64" else renderer, exercise.steps)
    optimizer = TorchOptim(lr=exercise.rate)
    components = standard_components(stages=[stage], blend=in_space(blend, exercise.color), optimizer=optimizer)
    components = replace(components, **{family: build_named(family, *part) for family, part in exercise.parts.items()})
    strokes = random_strokes(STROKES if renderer.warm_up is None else FEW, CANVAS).map(lambda value: value.to(kind))
    quiet: dict[str, Any] = dict.fromkeys(("logger", "enable_checkpointing", "enable_progress_bar"), False)
    timer = Timer(timedelta(seconds=patience), verbose=False)
    try:
        catalogue = Catalogue(strokes, components.optimizer.units)
        painter = StrokeOptimizer(
            catalogue, components, exercise.target.to(kind), torch.tensor(BACKGROUND).to(kind), seed=0,
            focus=None if exercise.focus is None else exercise.focus.to(kind), budget=exercise.growth * len(strokes),
        )  # fmt: skip
        L.Trainer(accelerator="cpu", max_epochs=-1, callbacks=[timer], enable_model_summary=False, **quiet).fit(painter)
        picture = painter.drawn()
        strokes = painter.catalogue().map(Tensor.detach)
        order = painter.depth.front_to_back
        scene = StressScene(strokes, exercise.target, len(strokes), order, exercise.color)
        exact = draw_scene(precise, blend, scene, strokes.map(Tensor.double))
    except (UserError, *CRASHES) as error:
        return check_of_error(error)
    taken = painter.schedule.step
    note = f"{taken} of {exercise.steps:,} steps" if taken < exercise.steps else ""
    return compare(dtype, DrawnScene(picture, {}, fault=range_fault(strokes)), exact, strokes, note)


def check_of_error(error: Exception) -> Check:
    """Refused if a user can act on the message of an exception, else broken."""
    if isinstance(error, UserError):
        return Check(Outcome.refused, note=str(error))
    return Check(Outcome.broken, note=f"{type(error).__name__}: {(str(error).splitlines() or [''])[0]}")


def compare(dtype: str, drawn: DrawnScene, exact: DrawnScene, strokes: Strokes, note: str = "") -> Check:
    """Compare what was drawn of strokes that came in the precision ``dtype`` with the same in float64."""
    bound = PICTURE_BOUNDS[dtype]
    wrong = [f"the gradient of {name} is not finite" for name, g in drawn.gradient.items() if not g.isfinite().all()]
    faults = [drawn.fault, _interval_fault("the picture", drawn.image, -bound, 1 + bound), *wrong]
    if any(faults):
        return Check(Outcome.broken, note=next(filter(None, faults)))
    picture = float((drawn.image.double() - exact.image).abs().max())
    slopes = [gradient_error(g, exact.gradient[name], name, strokes, exact.pull) for name, g in drawn.gradient.items()]
    slope = max(slopes, default=None)
    within = picture <= bound and (slope is None or slope <= GRADIENT_BOUNDS[dtype])
    return Check(Outcome.exact if within else Outcome.degraded, picture, slope, note)


def gradient_error(value: Tensor, exact: Tensor, name: str, strokes: Strokes, pull: float) -> float:
    """|g - g64| / (|g64| + NEGLIGIBLE_SHARE * pull), norms over all strokes.

    Gradients of points and widths, which are fractions of a window, count per pixel, so that large windows do not
    make rounding large.
    """
    difference, size = value.double() - exact.double(), exact.double()
    if name in ("start", "control", "end", "width"):
        per_pixel = 0.5 * strokes.scale.double().reshape(len(value), *[1] * (value.ndim - 1))
        difference, size = difference / per_pixel, size / per_pixel
    return float(difference.norm() / (size.norm() + NEGLIGIBLE_SHARE * pull + 1e-300))


def range_fault(strokes: Strokes, slack: float = 1e-6) -> str:
    """Which field of strokes is not finite or outside `FIELDS`; "" if none is."""
    faults = []
    for name, allowed in FIELDS.items():
        room = slack * max(abs(allowed.low), abs(allowed.high))
        faults.append(_interval_fault(name, getattr(strokes, name).detach(), allowed.low - room, allowed.high + room))
    return next(filter(None, faults), "")


@torch.no_grad()
def _alpha_fault(layers: Layers, size: tuple[int, int]) -> str:
    """What is wrong with the alpha of some strokes at some pixels."""
    index, pixel = _evenly(len(layers.reach), PROBED_STROKES), _evenly(size[0] * size[1], PROBED_PIXELS)
    alpha, color = layers.sample(index, pixel_centres(pixel, size[1], layers.color.dtype))
    slack = PICTURE_BOUNDS["float32"]
    wrong = _interval_fault("alpha of a stroke", alpha, -slack, 1 + slack)
    return wrong or _interval_fault("colour of a stroke", color, -torch.inf, torch.inf)


def _evenly(n: int, most: int) -> Tensor:
    """At most so many of n numbers from 0, evenly spaced (1, ...)."""
    return torch.linspace(0, n - 1, min(n, most)).round().long()[None]


def _interval_fault(name: str, value: Tensor, low: float, high: float) -> str:
    """What is wrong with numbers that should be finite and between two others; "" if nothing is."""
    if not value.isfinite().all():
        return f"{name} is not finite"
    if value.numel() and (value.min() < low or value.max() > high):
        return f"{name} goes from {float(value.min()):.3g} to {float(value.max()):.3g}"
    return ""
