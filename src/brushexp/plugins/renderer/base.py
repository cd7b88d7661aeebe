"""The contract of renderers, which say what each stroke covers (`Layers`)."""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar

import torch
from torch import Tensor, nn
from torch.utils.checkpoint import checkpoint

from brushexp.compositing.layers import PAINT_REACH, SOFT_EDGE, Layers
from brushexp.compositing.windows import Windows
from brushexp.errors import UserError
from brushexp.plugins.engine.base import Simulated
from brushexp.registry import plugin_of_class, plugins
from brushexp.strokes.bezier import half_width_of, softness_of
from brushexp.strokes.catalogue import Strokes, drawable
from brushexp.strokes.prior import clamp_to_prior, parameters_of, rewindow, strokes_of
from brushexp.system.checkpoint import CheckpointFormat
from brushexp.system.words import table_of_words

LEAST_ALPHA = 2 / 255  # in painting, what a network draws is nothing where its alpha is below this
TEXELS = 2**26  # so many texels of windows are held at once when no gradient is needed: 1 GB
SAMPLE_STROKES = 16  # strokes whose drawing is measured
CHUNK = 128  # strokes that a network draws at once: enough to keep the cores busy
PRECISIONS = ("float32", "bfloat16")  # a network paints in one of these; weights and pictures have 32 bits either way


def reach_of(strokes: Strokes, edge: float) -> Tensor:
    """Bound how far (N,), in pixels, strokes paint from their curves; ``edge`` is that of their renderer."""
    return PAINT_REACH * half_width_of(strokes) + 0.5 * softness_of(strokes) + edge


def weight_folders() -> list[Path]:
    """List the folders of weights that ship: ``weights`` beside the file of any renderer, of other packages too."""
    files = [__file__, *(found.origin for plugin in plugins("renderer") if (found := find_spec(plugin.module)))]
    return list(dict.fromkeys(Path(file).parent / "weights" for file in files if file))


RENDERERS = CheckpointFormat(
    noun="renderer",
    family="renderer",
    key="renderer.checkpoint",
    task=table_of_words("trained_by").get("renderer", "a package that trains renderers"),
    without="weights that are not trained",
    folders=weight_folders,
)


class Renderer(nn.Module, ABC):
    """Turns stroke parameters into layers: a subclass defines `forward`, and overrides others where it needs to.

    A renderer that is trained has an option ``checkpoint`` and calls `restore` at the end of its ``__init__``.
    ``tests/dabs.py`` has one with layers and a compiled kernel of its own.

    >>> from brushexp.registry import build_named
    >>> from brushexp.strokes.prior import sample_prior
    >>> layers = build_named("renderer", "analytic", {"soft": 1.0})(sample_prior(2))
    >>> alpha, color = layers.sample(torch.tensor([[0, 1]]), torch.zeros(1, 5, 2))
    >>> alpha.shape, color.shape  # of two strokes at five points
    (torch.Size([1, 2, 5]), torch.Size([1, 2, 1, 3]))
    """

    cost: ClassVar[str] = "not measured"  # time of a step, that of ``analytic`` being 1, at 512 px and 2,621 strokes
    weights: ClassVar[str] = "none"  # what has to be trained
    strokes: ClassVar[str] = "all"  # strokes that it can draw
    warm_up: str | None = None  # a slow renderer names the one that had better take most of the steps of a painting
    weights_hash: str = ""  # hash of the trained weights; "" without any
    edge: float = SOFT_EDGE  # pixels beyond ``PAINT_REACH`` half widths, and softness, where a stroke may still paint
    at_once: int | None = None  # strokes whose layers should be held at once at most; None if they are small

    def restore(self, checkpoint: str | None, **options: Any) -> None:
        """Load the trained weights of a checkpoint; None keeps those that the renderer was made with.

        ``options`` are those that the weights depend on. A checkpoint that was trained with others is refused
        (UserError); an option that is None is not compared.
        """
        plugin = plugin_of_class(type(self))
        name = type(self).__name__ if plugin is None else plugin.name
        compared = {key: value for key, value in options.items() if value is not None}
        self.weights_hash = RENDERERS.restore(self, name, checkpoint, compared)

    @classmethod
    def facts(cls) -> dict[str, str]:
        return {"cost": cls.cost, "gradient": "all fields", "weights": cls.weights, "strokes": cls.strokes}

    def __call__(self, strokes: Strokes) -> Layers:
        return super().__call__(drawable(strokes))

    @abstractmethod
    def forward(self, strokes: Strokes) -> Layers:
        """Make layers of N strokes on the canvas that they are measured on; differentiable in every field.

        A renderer with several looks chooses by ``strokes.brush``, so that a stroke keeps its look.
        """

    def clamp(self, strokes: Strokes) -> Strokes:
        """Bring strokes to the nearest ones that this renderer can draw; the painter does so after every step."""
        return strokes

    def distil(self, simulate: Callable[[Tensor, int], Simulated]) -> None:
        """Read parameters directly off strokes of a simulator; this is called once, before training.

        ``simulate`` paints strokes (n, 10), large enough to see details, as the simulator paints those of a data set
        that begins with the given number: this decides the brushes.
        """

    def convert(self, strokes: Strokes) -> Strokes:
        """Change strokes of another renderer into those that this one draws best, once, before the steps."""
        return self.clamp(strokes)

    def rows(self, strokes: Strokes) -> Tensor | None:
        """Bound the rows (N, 2), first and last, in pixels, that each stroke may touch; None for no bound.

        A picture that is too large for one piece is drawn in bands of rows, each with these strokes only.
        """
        return None


class PatchRenderer(Renderer):
    """Draws the window of every stroke with a network: a subclass says `draw` and ``window``, S in pixels."""

    cost = "high: a network draws every stroke"
    weights = "trained"
    strokes = "valid ones; others are clamped"
    warm_up = "textured"
    window: int
    precision: str = "float32"
    project: bool = True  # bring strokes into the range of training

    @abstractmethod
    def draw(self, parameters: Tensor) -> Tensor:
        """Draw pictures (n, 4, S, S) of strokes (n, 10) as `strokes.prior.parameters_of` writes them.

        These are RGBA in [0, 1], straight alpha, opaque where there is paint: the opacity of a stroke is applied later.
        """

    def forward(self, strokes: Strokes) -> Windows:
        """Draw the windows; with ``project`` strokes outside the range of training come to its edge first."""
        parameters = parameters_of(self.clamp(strokes))
        draw: Callable[[Tensor], Tensor] = self.draw if self.training else self._clean
        if not self.training and torch.is_grad_enabled():  # pictures are kept, activations are computed again
            draw = partial(checkpoint, self._clean, use_reentrant=False)
        parts = parameters.to(next(self.parameters(), parameters).dtype).split(CHUNK) if len(strokes) else ()
        none = parameters.new_zeros(0, 4, self.window, self.window)
        images = torch.cat([none, *(draw(part).to(parameters.dtype) for part in parts)])
        return Windows(images, strokes.position, strokes.scale, strokes.opacity, strokes.color)

    def _clean(self, parameters: Tensor) -> Tensor:
        """Draw without the faintest traces: a network leaves some everywhere, and each costs time."""
        with torch.autocast(parameters.device.type, torch.bfloat16, enabled=self.precision == "bfloat16"):
            pictures = self.draw(parameters)
        color, alpha = pictures.to(parameters.dtype).split([3, 1], dim=1)
        return torch.cat([color, torch.where(alpha < LEAST_ALPHA, 0.0, alpha)], dim=1)

    def seconds_per_stroke(self) -> float:
        """Measure on a few strokes how long it takes to draw one with its gradient."""
        parameters, was_training, times = torch.zeros(SAMPLE_STROKES, 10, requires_grad=True), self.training, []
        self.eval()  # as it paints
        for _ in range(2):  # the first one has what is done once
            begin = time.monotonic()
            torch.autograd.grad(self.forward(strokes_of(parameters)).images.sum(), parameters)
            times.append(time.monotonic() - begin)
        self.train(was_training)
        return min(times) / SAMPLE_STROKES

    @property
    def at_once(self) -> int:  # type: ignore[override]
        return TEXELS // self.window**2

    def clamp(self, strokes: Strokes) -> Strokes:
        return clamp_to_prior(strokes) if self.project else strokes

    def convert(self, strokes: Strokes) -> Strokes:
        return clamp_to_prior(rewindow(strokes))

    def rows(self, strokes: Strokes) -> Tensor:
        reach = strokes.scale * (0.5 + 0.5 / self.window)
        return torch.stack([strokes.position[:, 1] - reach, strokes.position[:, 1] + reach], dim=1)


def check_trained(renderer: Renderer, choice: str) -> None:
    """Raise a UserError if a renderer that draws nothing of use without trained weights has none; ``choice`` is typed.

    A member of the family says in ``weights`` that it has to be trained.
    """
    trainable = any(True for _ in renderer.parameters())
    if renderer.weights == Renderer.weights or renderer.weights_hash or not trainable:
        return
    plugin = plugin_of_class(type(renderer))
    name = choice if plugin is None else plugin.name
    cure = f"train it: brushexp {RENDERERS.task} renderer={choice} output=outputs/{choice}"
    file = f"renderer.checkpoint=outputs/{choice}/{name}.safetensors"
    raise UserError(f"renderer={choice} has no trained weights here, and would draw noise; {cure}, then add {file}")


def window_pictures(renderer: Renderer, parameters: Tensor, side: int, brush: Tensor | None = None) -> Tensor:
    """Draw strokes (n, 10) alone in their windows: (n, 4, side, side), RGBA, straight alpha.

    This is what renderers are trained on and compared by. Parameters are as `strokes.prior.parameters_of` writes them;
    ``brush`` (n,) is that of `Strokes`.
    """
    strokes = strokes_of(parameters)
    strokes = replace(strokes, position=strokes.position + 0.5 * side, scale=torch.full_like(strokes.scale, side))
    strokes = strokes if brush is None else replace(strokes, brush=brush)
    return renderer(strokes).pictures(side)
