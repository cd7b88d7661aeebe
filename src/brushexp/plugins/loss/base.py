"""Base class for losses, which reduce a painting to a number to minimise."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Mapping
from copy import deepcopy
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, ClassVar, Literal, TypeVar

import torch
from torch import Tensor, nn

from brushexp.bounds import at_least
from brushexp.pictures.focus import resample_weights
from brushexp.pictures.region import Region
from brushexp.strokes.catalogue import Strokes

T = TypeVar("T")


@dataclass(frozen=True)
class PaintedView:
    """The part of the canvas painted in a step, with everything that a loss may read."""

    image: Tensor  # (3, h, w) the region of this step in the painting, display-referred RGB in [0, 1]
    target: Tensor  # (3, h, w) target; the same object while steps view the same region
    strokes: Strokes  # all N strokes of the painting; only those that this step moves have a gradient
    surroundings: Surroundings | None = None  # the surrounding canvas; None if ``image`` is the whole canvas
    focus: Tensor | None = None  # (h, w) weights of the pixels, of mean 1 over the whole canvas; None for equal weights

    @property
    def whole_target(self) -> Tensor:
        """Target (3, H, W) of the whole canvas; it is the same object at every step."""
        return self.target if self.surroundings is None else self.surroundings.target

    @property
    def share(self) -> float:
        """Fraction of the canvas's pixels that ``image`` covers."""
        return self.image[0].numel() / self.whole_target[0].numel()

    def weights(self, values: Tensor) -> Tensor | None:
        """Resample ``focus`` to the size (h, w) of values (..., h, w), such as features; None for equal weights."""
        return None if self.focus is None else resample_weights(self.focus, (values.shape[-2], values.shape[-1]))

    def mean(self, values: Tensor) -> Tensor:
        """Compute the mean of values (..., h, w), such as features, weighted by ``focus``; 0 if there are no values."""
        weights = self.weights(values) if values.numel() else None
        return (values if weights is None else values * weights).sum() / max(values.numel(), 1)

    def around(self, context: int, grid: int = 1) -> PaintedView:
        """Widen the view by ``context`` pixels of the canvas on every side; these pixels have no gradient."""
        if self.surroundings is None or not context:
            return self
        wide = self.surroundings.widened(context, grid)
        image = wide.paste(self.image, self.surroundings.region)
        return replace(self, image=image, target=wide.part, focus=wide.part_focus, surroundings=wide)


@dataclass(frozen=True, eq=False)
class Surroundings:
    """The canvas around the region of a step; all steps with the same region share one object."""

    region: Region  # region of the step
    picture: Tensor  # (3, H, W) the whole picture as last painted, without gradient
    target: Tensor  # (3, H, W) the whole target
    focus: Tensor | None = None  # (H, W) weights of the pixels of the target; None for equal weights
    core: Region | None = None  # the part of the region that steps change; None for the whole region
    part: Tensor = field(init=False)  # (3, h, w) the target in the region
    part_focus: Tensor | None = field(init=False)  # (h, w) the focus in the region
    _wider: dict[tuple[int, int], Surroundings] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "part", self.region.of(self.target).contiguous())
        object.__setattr__(self, "part_focus", None if self.focus is None else self.region.of(self.focus))

    def widened(self, context: int, grid: int) -> Surroundings:
        """Widen the region by ``context`` pixels; equal arguments yield the same object."""
        if (context, grid) not in self._wider:
            region = self.region.widened(context, (self.picture.shape[1], self.picture.shape[2]), grid)
            self._wider[context, grid] = replace(self, region=region, core=self.core or self.region, _wider={})
        return self._wider[context, grid]

    def paste(self, image: Tensor, place: Region) -> Tensor:
        """Return a copy of the region as last painted, with ``image`` (3, h, w) pasted into the region ``place``."""
        picture = self.region.of(self.picture).to(image.dtype, copy=True)
        inside = replace(place, top=place.top - self.region.top, left=place.left - self.region.left)
        inside.of(picture).copy_(image)
        return picture


class Loss(nn.Module, ABC):
    """A term of the objective; class attributes hold facts that help users choose a loss.

    >>> import torch
    >>> from brushexp.strokes.catalogue import Strokes
    >>> class MeanColour(Loss):
    ...     '''Squared difference of the mean colours.'''
    ...     weight, looks_at = 0.5, "canvas"
    ...     def forward(self, view):
    ...         return (view.image - view.whole_target).mean((1, 2)).square().sum()
    >>> view = PaintedView(torch.ones(3, 4, 6), torch.zeros(3, 4, 6), Strokes.none())
    >>> total, terms = weighted_sum({"mean_colour": MeanColour()}, view)
    >>> float(total), float(terms["mean_colour"])
    (1.5, 3.0)
    >>> MeanColour.facts()["gradient"]
    'picture'

    ``looks_at`` has one of three values: "pixels" for a focus-weighted mean over the pixels in ``view.image``, where
    each part of the canvas counts in proportion to its area; "canvas" for a value of the whole canvas, computed with
    ``view.surroundings``; or "strokes" for a loss without a gradient in the picture. The last two kinds ignore the
    focus. If ``context`` is set, the region that the loss receives is widened by this many pixels and starts at
    multiples of ``grid`` pixels, the stride of a network.

    Args:
        weight: factor in the sum of losses; logs show the unweighted loss.
    """

    tunable: ClassVar[dict[str, Any]] = {"weight": Annotated[float, at_least(0)]}  # options of every loss
    weight: float = 1.0  # default weight
    label: str = ""  # name in logs, if it differs from that of the plugin
    looks_at: ClassVar[Literal["pixels", "canvas", "strokes"]] = "pixels"
    cost: ClassVar[str] = ""  # time of a step with only this loss, relative to ``mse`` (benchmarks/losses.py)
    exact_on_parts: ClassVar[bool] = True  # whether gradients on parts of the canvas are exact
    context: int = 0
    grid: int = 1

    def __init__(self) -> None:
        super().__init__()
        self._target: Tensor | None = None  # last target of `of_target`
        self._results: dict[Hashable, Any] = {}  # results for that target, by key

    @abstractmethod
    def forward(self, view: PaintedView) -> Tensor:
        """Compute the loss, a scalar that is 0 for a perfect painting."""

    def of_target(self, target: Tensor, compute: Callable[[Tensor], T], key: Hashable = None) -> T:
        """Return ``compute(target)``, without gradient, and cache it by ``key`` until the target changes."""
        if target is not self._target:  # a reference, so that no other object can get the same identity
            self._target, self._results = target, {}
        if key not in self._results:
            with torch.no_grad():
                self._results[key] = compute(target)
        return self._results[key]

    @classmethod
    def facts(cls) -> dict[str, str]:
        return {
            "cost": cls.cost or "not measured",
            "gradient": "strokes only" if cls.looks_at == "strokes" else "picture",
            "on parts of the canvas": "exact" if cls.exact_on_parts else "approximate",
            "focus": "honoured" if cls.looks_at == "pixels" else "ignored",
        }


class StyleLoss(Loss):
    """A loss that compares the style of a painting with that of a style picture."""

    colors: str  # "style": the target takes the colours of the style picture; "content": vice versa

    @abstractmethod
    def check(self, size: tuple[int, int]) -> int:
        """Return the style picture's longer side for a canvas of ``size`` (H, W), or raise a UserError."""

    @abstractmethod
    def picture(self, target: Tensor) -> Tensor:
        """Load the style picture (3, h, w) for the target (3, H, W) of the whole canvas."""

    @abstractmethod
    def measure(self, picture: Tensor, target: Tensor) -> dict[str, float]:
        """Measure the distances between a picture (3, H, W) and the style, and return them by name."""


class BrushworkLoss(Loss):
    """A loss that compares the strokes of a painting with those of another painting."""

    @abstractmethod
    def arrange(self, strokes: Strokes, size: tuple[int, int], generator: torch.Generator) -> Strokes:
        """Give the initial strokes, on a canvas of ``size`` (H, W), the shapes of the other painting's strokes."""


def state_of(losses: Mapping[str, Loss]) -> dict[str, dict[str, Any]]:
    """Return a copy of each loss's state, by name."""
    return {name: deepcopy(loss.state_dict()) for name, loss in losses.items()}


def restore(losses: Mapping[str, Loss], state: Mapping[str, Mapping[str, Any]]) -> None:
    """Load the result of `state_of`."""
    for name, loss in losses.items():
        loss.load_state_dict(state[name])


def weighted_sum(losses: Mapping[str, Loss], view: PaintedView) -> tuple[Tensor, dict[str, Tensor]]:
    """Compute the objective, which is the weighted sum of the losses, and each unweighted loss."""
    terms, weighted = {}, []
    for name, loss in losses.items():
        wider = view.around(loss.context, loss.grid)
        terms[name] = loss(wider)
        weighted.append(loss.weight * (wider.share if loss.looks_at == "pixels" else 1) * terms[name])
    return torch.stack(weighted).sum(), terms
