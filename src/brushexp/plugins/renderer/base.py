"""Base class for renderers, which compute the area covered by each stroke (`Layers`)."""

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

LEAST_ALPHA = 2 / 255  # in painting, smaller alphas of a network count as 0
TEXELS = 2**26  # largest number of texels of windows held at once when no gradient is needed: 1 GB
SAMPLE_STROKES = 16  # number of strokes whose drawing is timed
CHUNK = 128  # number of strokes that a network draws at once, enough to keep the cores busy
PRECISIONS = ("float32", "bfloat16")  # precisions in which a network paints; weights and pictures have 32 bits


def reach_of(strokes: Strokes, edge: float) -> Tensor:
    """Return upper bounds (N,), in pixels, on how far paint extends from a stroke's curve, including ``edge``."""
    return PAINT_REACH * half_width_of(strokes) + 0.5 * softness_of(strokes) + edge


def weight_folders() -> list[Path]:
    """List the folders with shipped weights: ``weights`` next to each renderer's file, in the core and in packages."""
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
    """Turns stroke parameters into layers; a subclass defines `forward` and overrides other methods as needed.

    A trained renderer has a ``checkpoint`` option and calls `restore` at the end of its ``__init__``.
    ``tests/dabs.py`` contains an example with its own layers and compiled kernel.

    >>> from brushexp.registry import build_named
    >>> from brushexp.strokes.prior import sample_prior
    >>> layers = build_named("renderer", "analytic", {"soft": 1.0})(sample_prior(2))
    >>> alpha, color = layers.sample(torch.tensor([[0, 1]]), torch.zeros(1, 5, 2))
    >>> alpha.shape, color.shape  # of two strokes at five points
    (torch.Size([1, 2, 5]), torch.Size([1, 2, 1, 3]))
    """

    cost: ClassVar[str] = "not measured"  # time of a step relative to ``analytic``, at 512 px and 2,621 strokes
    weights: ClassVar[str] = "none"  # description of the weights to train
    strokes: ClassVar[str] = "all"  # strokes that the renderer can draw
    warm_up: str | None = None  # fast renderer that takes most of the steps of a painting in place of a slow one
    weights_hash: str = ""  # hash of the trained weights; "" if there are none
    edge: float = SOFT_EDGE  # pixels that a stroke may paint beyond ``PAINT_REACH`` half widths and softness
    at_once: int | None = None  # largest number of strokes whose layers to hold at once; None if layers are small

    def restore(self, checkpoint: str | None, **options: Any) -> None:
        """Load the trained weights of a checkpoint; None keeps the initial weights.

        Raises a UserError if the checkpoint was trained with ``options`` other than these; options that are None are
        not compared.
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
        """Render N strokes as layers, in canvas pixels, differentiable with respect to every field.

        A renderer with several textures selects one by ``strokes.brush``, so that each stroke keeps its texture.
        """

    def clamp(self, strokes: Strokes) -> Strokes:
        """Clamp strokes to the nearest strokes that this renderer can draw; painters call this after every step."""
        return strokes

    def held(self, strokes: Strokes) -> Tensor | None:
        """Return the indices (K,) of the strokes that steps leave as they are; None if steps move all strokes."""
        return None

    def distil(self, simulate: Callable[[Tensor, int], Simulated]) -> None:
        """Derive parameters directly from simulated strokes; called once, before training.

        ``simulate`` paints strokes from parameters (n, 10), large enough to show details. Its second argument is the
        index of the first of these strokes in the data set, which determines their brushes.
        """

    def convert(self, strokes: Strokes) -> Strokes:
        """Adapt strokes made for another renderer to what this one draws best; called once, before the steps."""
        return self.clamp(strokes)

    def rows(self, strokes: Strokes) -> Tensor | None:
        """Return the first and last pixel row (N, 2) that each stroke may touch; None if unknown.

        Pictures that are too large for one pass are painted in bands of rows, each with the strokes that touch it.
        """
        return None


class PatchRenderer(Renderer):
    """Draws each stroke's window with a network; a subclass defines `draw` and ``window``, the side S in pixels."""

    cost = "high: a network draws every stroke"
    weights = "trained"
    strokes = "valid ones; others are clamped"
    warm_up = "textured"
    window: int
    precision: str = "float32"
    project: bool = True  # whether to clamp strokes to the range of training

    @abstractmethod
    def draw(self, parameters: Tensor) -> Tensor:
        """Draw pictures (n, 4, S, S) of strokes, given parameters (n, 10) from `strokes.prior.parameters_of`.

        The pictures are RGBA in [0, 1] with straight alpha, opaque where there is paint; stroke opacity is applied
        later.
        """

    def forward(self, strokes: Strokes) -> Windows:
        """Draw the windows; with ``project``, strokes outside the range of training are first clamped to it."""
        parameters = parameters_of(self.clamp(strokes))
        draw: Callable[[Tensor], Tensor] = self.draw if self.training else self._clean
        if not self.training and torch.is_grad_enabled():  # stores pictures and recomputes activations
            draw = partial(checkpoint, self._clean, use_reentrant=False)
        parts = parameters.to(next(self.parameters(), parameters).dtype).split(CHUNK) if len(strokes) else ()
        none = parameters.new_zeros(0, 4, self.window, self.window)
        images = torch.cat([none, *(draw(part).to(parameters.dtype) for part in parts)])
        return Windows(images, strokes.position, strokes.scale, strokes.opacity, strokes.color)

    def _clean(self, parameters: Tensor) -> Tensor:
        """Draw strokes, and remove the faint traces that a network leaves everywhere, which slow down compositing."""
        with torch.autocast(parameters.device.type, torch.bfloat16, enabled=self.precision == "bfloat16"):
            pictures = self.draw(parameters)
        color, alpha = pictures.to(parameters.dtype).split([3, 1], dim=1)
        return torch.cat([color, torch.where(alpha < LEAST_ALPHA, 0.0, alpha)], dim=1)

    def seconds_per_stroke(self) -> float:
        """Measure, on a small sample, how many seconds it takes to draw a stroke and compute its gradient."""
        parameters, was_training, times = torch.zeros(SAMPLE_STROKES, 10, requires_grad=True), self.training, []
        self.eval()  # the mode in which it paints
        for _ in range(2):  # the first call includes one-time work
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
    """Raise a UserError if a renderer needs trained weights but has none; ``choice`` is the name that the user typed.

    A renderer's attribute ``weights`` states whether the renderer has to be trained.
    """
    trainable = any(True for _ in renderer.parameters())
    if renderer.weights == Renderer.weights or renderer.weights_hash or not trainable:
        return
    plugin = plugin_of_class(type(renderer))
    name = choice if plugin is None else plugin.name
    cure = f"train it: brushexp {RENDERERS.task} renderer={choice} output=outputs/{choice}"
    file = f"renderer.checkpoint=outputs/{choice}/{name}.safetensors"
    raise UserError(f"renderer={choice} has no trained weights and would draw noise; {cure}, then add {file}")


def window_pictures(renderer: Renderer, parameters: Tensor, side: int, brush: Tensor | None = None) -> Tensor:
    """Draw n strokes, each alone in its window, as pictures (n, 4, side, side), RGBA with straight alpha.

    Renderers are trained and compared on such pictures. The parameters (n, 10) have the format of
    `strokes.prior.parameters_of`; ``brush`` (n,) is the field of that name in `Strokes`.
    """
    strokes = strokes_of(parameters)
    strokes = replace(strokes, position=strokes.position + 0.5 * side, scale=torch.full_like(strokes.scale, side))
    strokes = strokes if brush is None else replace(strokes, brush=brush)
    return renderer(strokes).pictures(side)
