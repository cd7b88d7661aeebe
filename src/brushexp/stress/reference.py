"""Cells of one picture: a scene drawn forwards and backwards in one precision, against float64."""

from copy import deepcopy

import torch
from torch import Tensor

from brushexp.compositing.layers import Layers
from brushexp.errors import UserError
from brushexp.plugins.blend.base import Blend, pixel_centres
from brushexp.plugins.blend.dense import Dense
from brushexp.plugins.renderer.base import Renderer
from brushexp.stress.check import DTYPES, PICTURE_BOUNDS, Check, DrawnScene, Outcome, compare
from brushexp.stress.scenes import BACKGROUND, StressScene
from brushexp.strokes.catalogue import PRECISE, Strokes

FEW_STROKES = 6  # at most, of a renderer that is slow (one with a warm-up renderer)
MANY_STROKES = 1_000_000  # at most, of others
PROBED_STROKES, PROBED_PIXELS = 64, 2000  # at which alpha is looked at, at most
CRASHES = (RuntimeError, TypeError, ValueError, LookupError, ArithmeticError, MemoryError, AssertionError)


def most_strokes(renderer: Renderer) -> int:
    """Strokes that are worth waiting for."""
    return MANY_STROKES if renderer.warm_up is None else FEW_STROKES


def draw_scene(renderer: Renderer, blend: Blend, scene: StressScene, strokes: Strokes) -> DrawnScene:
    """The picture of ``strokes`` on the canvas of a scene, and the gradient of its mean squared error."""
    strokes = strokes.map(lambda value: value.detach().clone().requires_grad_())
    layers = renderer(strokes)
    image = blend(layers, scene.front_to_back, scene.size, torch.tensor(BACKGROUND)).image
    error = image - scene.target.to(image)
    if image.requires_grad:
        error.square().mean().backward()
    gradient = {name: torch.zeros_like(v) if v.grad is None else v.grad for name, v in strokes.items()}
    pull = float(2 * error.detach().double().abs().mean())
    return DrawnScene(image.detach(), gradient, pull, _alpha_fault(layers, scene.size))


class Reference:
    """A scene in float64, each picture drawn once.

    Args:
        renderer: what draws it.
        scene: what is drawn.
    """

    def __init__(self, renderer: Renderer, scene: StressScene) -> None:
        self.renderer = deepcopy(renderer).double()
        self.scene = scene
        self._drawn: dict[tuple[Blend | None, str], DrawnScene] = {}

    def by(self, blend: Blend | None, dtype: str) -> DrawnScene:
        """The strokes as ``dtype`` holds them, drawn in float64; None for every stroke at every pixel."""
        kind = DTYPES[dtype]
        held = "" if kind in PRECISE else dtype
        if (blend, held) not in self._drawn:
            strokes = self.scene.strokes.map(lambda value: (value.to(kind) if held else value).double())
            self._drawn[blend, held] = draw_scene(self.renderer, blend or Dense(), self.scene, strokes)
        return self._drawn[blend, held]


def check_drawing(renderer: Renderer, blend: Blend, reference: Reference, dtype: str) -> Check:
    """Check what a renderer and a blend make of a scene in one precision.

    In float64 against every stroke at every pixel (``blend=dense``): this says what a blend leaves out by design. In
    the others against the same blend in float64 and the same strokes as the precision holds them: this says what the
    arithmetic costs.
    """
    scene = reference.scene
    strokes = scene.strokes
    note = f"{len(strokes)} of {scene.wanted:,} strokes" if len(strokes) < scene.wanted else ""
    try:
        in_full = compare("float64", reference.by(blend, "float64"), reference.by(None, "float64"), strokes, note)
        if dtype == "float64":
            return in_full
        drawn = draw_scene(renderer, blend, scene, strokes.map(lambda value: value.to(DTYPES[dtype])))
        exact = reference.by(None if in_full.outcome is Outcome.exact else blend, dtype)
        return compare(dtype, drawn, exact, strokes, note)
    except (UserError, *CRASHES) as error:
        return check_of_error(error)


def check_of_error(error: Exception) -> Check:
    """Refused if a user can act on the message of an exception, else broken."""
    if isinstance(error, UserError):
        return Check(Outcome.refused, note=str(error))
    return Check(Outcome.broken, note=f"{type(error).__name__}: {(str(error).splitlines() or [''])[0]}")


@torch.no_grad()
def _alpha_fault(layers: Layers, size: tuple[int, int]) -> str:
    """What is wrong with the alpha of some strokes at some pixels."""
    count, pixels = len(layers.reach), size[0] * size[1]
    if not count:
        return ""
    index, pixel = _evenly(count, PROBED_STROKES), _evenly(pixels, PROBED_PIXELS)
    alpha, color = layers.sample(index, pixel_centres(pixel, size[1], layers.color.dtype))
    if not (alpha.isfinite().all() and color.isfinite().all()):
        return "alpha or colour of a stroke is not finite"
    slack = PICTURE_BOUNDS["float32"]
    if alpha.min() < -slack or alpha.max() > 1 + slack:
        return f"alpha goes from {float(alpha.min()):.3g} to {float(alpha.max()):.3g}"
    return ""


def _evenly(n: int, most: int) -> Tensor:
    """At most so many of n numbers from 0, evenly spaced (1, ...)."""
    return torch.linspace(0, n - 1, min(n, most)).round().long()[None]
