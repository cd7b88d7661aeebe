"""Cells of one picture: a scene drawn forwards and backwards in one precision, against float64."""

from copy import deepcopy
from dataclasses import dataclass

import torch
from torch import Tensor

from brushexp.compositing.layers import Layers
from brushexp.errors import UserError
from brushexp.plugins.blend.base import Blend, pixel_centres
from brushexp.plugins.blend.dense import Dense
from brushexp.plugins.renderer.base import Renderer
from brushexp.stress.scenes import BACKGROUND, Scene
from brushexp.stress.verdict import DTYPES, PICTURE, Judgement, Verdict, judge
from brushexp.strokes.catalogue import PRECISE, Strokes

FEW = 6  # strokes of a renderer that is slow (one with a stand-in)
MOST = 1_000_000  # and of others
ASKED = 64  # strokes whose alpha is looked at, at most
CRASHES = (RuntimeError, TypeError, ValueError, LookupError, ArithmeticError, MemoryError, AssertionError)
PLACES = 2000  # pixels where it is, at most


@dataclass(frozen=True)
class Drawn:
    """A scene drawn forwards and backwards.

    Attributes:
        image: (3, H, W).
        gradient: of the mean squared error, field -> as the field.
        pull: sum of |dL/dI| over the picture.
        faults: "" or what is wrong with alpha.
    """

    image: Tensor
    gradient: dict[str, Tensor]
    pull: float
    faults: str


def most_for(renderer: Renderer) -> int:
    """Strokes that are worth waiting for."""
    return MOST if renderer.warm_up is None else FEW


def draw(renderer: Renderer, blend: Blend, scene: Scene, strokes: Strokes) -> Drawn:
    """The picture of ``strokes`` on the canvas of a scene, and the gradient of its mean squared error."""
    strokes = strokes.map(lambda value: value.detach().clone().requires_grad_())
    layers = renderer(strokes)
    image = blend(layers, scene.front_to_back, scene.size, torch.tensor(BACKGROUND)).image
    error = image - scene.target.to(image)
    if image.requires_grad:
        error.square().mean().backward()
    gradient = {name: torch.zeros_like(v) if v.grad is None else v.grad for name, v in strokes.items()}
    pull = float(2 * error.detach().double().abs().mean())
    return Drawn(image.detach(), gradient, pull, _fault_of(layers, scene.size))


class Reference:
    """A scene in float64, each picture drawn once.

    Args:
        renderer: what draws it.
        scene: what is drawn.
    """

    def __init__(self, renderer: Renderer, scene: Scene) -> None:
        self.renderer = deepcopy(renderer).double()
        self.scene = scene
        self._drawn: dict[tuple[Blend | None, str], Drawn] = {}

    def by(self, blend: Blend | None, dtype: str) -> Drawn:
        """The strokes as ``dtype`` holds them, drawn in float64; None for every stroke at every pixel."""
        kind = DTYPES[dtype]
        held = "" if kind in PRECISE else dtype
        if (blend, held) not in self._drawn:
            strokes = self.scene.strokes.map(lambda value: (value.to(kind) if held else value).double())
            self._drawn[blend, held] = draw(self.renderer, blend or Dense(), self.scene, strokes)
        return self._drawn[blend, held]

    def compare(self, dtype: str, drawn: Drawn, exact: Drawn) -> Judgement:
        """What is to be said about one of them against the other."""
        few = len(self.scene.strokes), self.scene.wanted
        return judge(
            dtype, drawn.image, exact.image, drawn.gradient, exact.gradient,
            strokes=self.scene.strokes, pull=exact.pull, faults=drawn.faults,
            note=f"{few[0]} of {few[1]:,} strokes" if few[0] < few[1] else "",
        )  # fmt: skip


def draw_cell(renderer: Renderer, blend: Blend, reference: Reference, dtype: str) -> Judgement:
    """Judge what a renderer and a blend make of a scene in one precision.

    In float64 against every stroke at every pixel (``blend=dense``): this says what a blend leaves out by design. In
    the others against the same blend in float64 and the same strokes as the precision holds them: this says what the
    arithmetic costs.
    """
    scene = reference.scene
    try:
        in_full = reference.compare("float64", reference.by(blend, "float64"), reference.by(None, "float64"))
        if dtype == "float64":
            return in_full
        drawn = draw(renderer, blend, scene, scene.strokes.map(lambda value: value.to(DTYPES[dtype])))
        exact = reference.by(None if in_full.verdict is Verdict.exact else blend, dtype)
        return reference.compare(dtype, drawn, exact)
    except UserError as error:
        return Judgement(Verdict.refused, note=str(error))
    except CRASHES as error:
        return broken_by(error)


def broken_by(error: BaseException) -> Judgement:
    """The verdict on what ended in an exception that no user can mend."""
    return Judgement(Verdict.broken, note=f"{type(error).__name__}: {(str(error).splitlines() or [''])[0]}")


@torch.no_grad()
def _fault_of(layers: Layers, size: tuple[int, int]) -> str:
    """What is wrong with the alpha of some strokes at some pixels."""
    count, pixels = len(layers.reach), size[0] * size[1]
    if not count:
        return ""
    index = torch.linspace(0, count - 1, min(count, ASKED)).round().long()[None]
    pixel = torch.linspace(0, pixels - 1, min(pixels, PLACES)).round().long()[None]
    alpha, color = layers.sample(index, pixel_centres(pixel, size[1], layers.color.dtype))
    if not (alpha.isfinite().all() and color.isfinite().all()):
        return "alpha or colour of a stroke is not finite"
    slack = PICTURE["float32"]
    if alpha.min() < -slack or alpha.max() > 1 + slack:
        return f"alpha goes from {float(alpha.min()):.3g} to {float(alpha.max()):.3g}"
    return ""
