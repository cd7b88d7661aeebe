"""Draw a scene and compute its gradients, or optimise strokes, in one precision; compare the result with float64."""

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from datetime import timedelta
from typing import Any

import lightning as L
import torch
from lightning.pytorch.callbacks import Timer
from torch import Tensor

from brushexp.contracts import UserError, build_named
from brushexp.contracts.families import Blend, Compositor, Renderer, pixel_centres
from brushexp.contracts.layers import Layers, Size
from brushexp.contracts.members import Dense, TorchOptim
from brushexp.contracts.painting import Stage, StrokeOptimizer, standard_components
from brushexp.contracts.strokes import FIELDS, PRECISE, Catalogue, Strokes, drawable
from brushexp_thesis.extremes.scenes import Scene

EXACT, DEGRADED, REFUSED, BROKEN = VERDICTS = ("exact", "degraded", "refused", "broken")  # see docs/numerics.md
DTYPES = {"float64": torch.float64, "float32": torch.float32, "bfloat16": torch.bfloat16, "float16": torch.float16}
# Maximum difference of a pixel, in [0, 1]. Strokes of 16 bits are drawn in float32, so their pictures are as exact.
PICTURE_BOUNDS = {"float64": 1e-9, "float32": 1e-4, "bfloat16": 1e-4, "float16": 1e-4}
# Maximum relative difference of a field's gradient; see `gradient_error`. In 16 bits, it is the error of one rounding.
GRADIENT_BOUNDS = {"float64": 1e-6, "float32": 1e-3, "bfloat16": 2**-8, "float16": 2**-9}
NEGLIGIBLE_SHARE = 1e-3  # share of the sum of |dL/dI| over all pixels below which a gradient is negligible
PROBED_STROKES, PROBED_PIXELS = 64, 2000  # maximum number of strokes and pixels at which alpha is checked
CRASHES = (RuntimeError, TypeError, ValueError, LookupError, ArithmeticError, MemoryError, AssertionError)
BACKGROUND = (0.2, 0.5, 0.9)
DENSE = Dense()


@dataclass(frozen=True)
class Check:
    """A verdict and the errors on which it is based."""

    verdict: str
    picture: float | None = None  # largest difference of a pixel from float64
    gradient: float | None = None  # largest relative difference of a gradient
    note: str = ""  # message, fault, or number of strokes or steps


@dataclass(frozen=True)
class Drawn:
    """A picture (3, H, W), and the gradient of its mean squared error with respect to each field of the strokes."""

    image: Tensor
    gradient: Mapping[str, Tensor]
    pull: float = 0.0  # sum of |dL/dI| over the picture, the scale of its gradients
    fault: str = ""  # description of a fault


def draw(renderer: Renderer, blend: Compositor, strokes: Strokes, target: Tensor, order: Tensor | None = None) -> Drawn:
    """Draw strokes, and compute the gradients of the mean squared error between the picture and a target (3, H, W).

    ``order`` (N,) lists the strokes' indices from top to bottom; None means that the first stroke is on top.
    """
    size: Size = (target.shape[1], target.shape[2])
    strokes = strokes.map(lambda value: value.detach().clone().requires_grad_())
    layers = renderer(strokes)
    order = torch.arange(len(strokes)) if order is None else order
    image = blend(layers, order, size, torch.tensor(BACKGROUND)).image
    error = image - target.to(image)
    if image.requires_grad:
        error.square().mean().backward()
    gradient = {name: torch.zeros_like(v) if v.grad is None else v.grad for name, v in strokes.items()}
    return Drawn(image.detach(), gradient, float(2 * error.detach().double().abs().mean()), _alpha_fault(layers, size))


class SceneCheck:
    """Checks of one renderer on one scene; float64 pictures are cached."""

    def __init__(self, renderer: Renderer, scene: Scene, most: int) -> None:
        self.renderer, self.precise = renderer, deepcopy(renderer).double()
        self.scene, self.strokes, self.target = scene, scene.strokes(most), scene.target(scene.canvas)
        self.color = build_named("color", scene.color, {})
        self._exact: dict[tuple[Blend, str], Drawn] = {}

    def check(self, blend: Blend, dtype: str) -> Check:
        """Check a blend in one precision.

        In float64, the reference evaluates every stroke at every pixel (``blend=dense``), which reveals what a blend
        omits by design. In other precisions, the reference is the same blend in float64, with the strokes rounded to
        that precision first, which isolates arithmetic errors.
        """
        n = len(self.strokes)
        note = f"{n} of {self.scene.n:,} strokes" if n < self.scene.n else ""
        try:
            if dtype == "float64":
                return compare(dtype, self.exact(blend, dtype), self.exact(DENSE, dtype), self.strokes, note)
            rounded = self.strokes.map(lambda value: value.to(DTYPES[dtype]))
            drawn = draw(self.renderer, Compositor(blend, self.color), rounded, self.target)
            return compare(dtype, drawn, self.exact(blend, dtype), self.strokes, note)
        except (UserError, *CRASHES) as error:
            return check_of_error(error)

    def exact(self, blend: Blend, dtype: str) -> Drawn:
        """Draw the strokes in float64 after rounding them to ``dtype``."""
        kind = self.strokes.position.dtype if DTYPES[dtype] in PRECISE else DTYPES[dtype]
        if (blend, str(kind)) not in self._exact:
            strokes = drawable(self.strokes.map(lambda value: value.to(kind))).map(Tensor.double)
            self._exact[blend, str(kind)] = draw(self.precise, Compositor(blend, self.color), strokes, self.target)
        return self._exact[blend, str(kind)]


def check_painting(name: str, renderer: Renderer, scene: Scene, patience: float, blend: Blend, dtype: str) -> Check:
    """Optimise a few strokes for up to ``patience`` seconds; check that they stay in range and are drawn accurately."""
    precise, kind, color = deepcopy(renderer).double(), DTYPES[dtype], build_named("color", scene.color, {})
    stage = Stage(name, precise if dtype == "float64" else renderer, scene.steps)
    components = standard_components(stages=[stage], blend=blend, color=color, optimizer=TorchOptim(lr=scene.rate))
    components = replace(components, **{family: build_named(family, *part) for family, part in scene.parts.items()})
    strokes = scene.strokes(scene.n if renderer.warm_up is None else 2).map(lambda value: value.to(kind))
    target, focus = scene.target(scene.canvas), scene.focus and scene.focus(scene.canvas).to(kind)
    quiet: dict[str, Any] = dict.fromkeys(("logger", "enable_checkpointing", "enable_progress_bar"), False)
    timer = Timer(timedelta(seconds=patience), verbose=False)
    try:
        catalogue = Catalogue(strokes, components.optimizer.units)
        painter = StrokeOptimizer(
            catalogue, components, target.to(kind), torch.tensor(BACKGROUND).to(kind), seed=0,
            focus=focus, budget=scene.growth * len(strokes),
        )  # fmt: skip
        L.Trainer(accelerator="cpu", max_epochs=-1, callbacks=[timer], enable_model_summary=False, **quiet).fit(painter)
        picture, strokes = painter.draw_whole(), painter.catalogue().map(Tensor.detach)
        exact = draw(precise, components.blend, strokes.map(Tensor.double), target, painter.front_to_back)
    except (UserError, *CRASHES) as error:
        return check_of_error(error)
    n = painter.schedule.step
    note = f"{n} of {scene.steps:,} steps" if n < scene.steps else ""
    return compare(dtype, Drawn(picture, {}, fault=range_fault(strokes)), exact, strokes, note)


def check_of_error(error: Exception) -> Check:
    """Classify an exception: a UserError means that the scene is refused; any other error is a fault in the program."""
    if isinstance(error, UserError):
        return Check(REFUSED, note=str(error))
    return Check(BROKEN, note=f"{type(error).__name__}: {(str(error).splitlines() or [''])[0]}")


def compare(dtype: str, drawn: Drawn, exact: Drawn, strokes: Strokes, note: str = "") -> Check:
    """Compare a picture and its gradients, computed in the precision ``dtype``, with those computed in float64."""
    bound = PICTURE_BOUNDS[dtype]
    faults = [drawn.fault, _fault("the picture", drawn.image, -bound, 1 + bound)]
    faults += [_fault(f"the gradient of {name}", gradient) for name, gradient in drawn.gradient.items()]
    if any(faults):
        return Check(BROKEN, note=next(filter(None, faults)))
    picture = float((drawn.image.double() - exact.image).abs().max())
    errors = [gradient_error(g, exact.gradient[name], name, strokes, exact.pull) for name, g in drawn.gradient.items()]
    gradient = max(errors, default=None)
    is_exact = picture <= bound and (gradient is None or gradient <= GRADIENT_BOUNDS[dtype])
    return Check(EXACT if is_exact else DEGRADED, picture, gradient, note)


def gradient_error(value: Tensor, exact: Tensor, name: str, strokes: Strokes, pull: float) -> float:
    """Compute |g - g64| / (|g64| + NEGLIGIBLE_SHARE * pull), with norms over all strokes.

    Gradients with respect to points and widths, which are fractions of a window, are converted to gradients per pixel.
    """
    difference, size = value.double() - exact.double(), exact.double()
    if name in ("start", "control", "end", "width"):
        per_pixel = 0.5 * strokes.scale.double().reshape(len(value), *[1] * (value.ndim - 1))
        difference, size = difference / per_pixel, size / per_pixel
    return float(difference.norm() / (size.norm() + NEGLIGIBLE_SHARE * pull + 1e-300))


def range_fault(strokes: Strokes) -> str:
    """Name a field that is not finite or is outside its range in `FIELDS`; return "" if all fields are valid."""
    for name, bounds in FIELDS.items():
        slack = 1e-6 * max(abs(bounds.low), abs(bounds.high))
        if fault := _fault(name, getattr(strokes, name).detach(), bounds.low - slack, bounds.high + slack):
            return fault
    return ""


@torch.no_grad()
def _alpha_fault(layers: Layers, size: Size) -> str:
    """Describe a fault in the alpha or colour of sampled strokes at sampled pixels; return "" if there is none."""
    pairs = ((len(layers.reach), PROBED_STROKES), (size[0] * size[1], PROBED_PIXELS))
    index, pixel = (torch.linspace(0, n - 1, min(n, most)).round().long()[None] for n, most in pairs)
    alpha, color = layers.sample(index, pixel_centres(pixel, size[1], layers.color.dtype))
    slack = PICTURE_BOUNDS["float32"]
    return _fault("alpha of a stroke", alpha, -slack, 1 + slack) or _fault("colour of a stroke", color)


def _fault(name: str, value: Tensor, low: float = -torch.inf, high: float = torch.inf) -> str:
    """Describe the fault if any element of ``value`` is not finite or is out of bounds; return "" otherwise."""
    if not value.isfinite().all():
        return f"{name} is not finite"
    if value.numel() and (value.min() < low or value.max() > high):
        return f"{name} goes from {float(value.min()):.3g} to {float(value.max()):.3g}"
    return ""
