"""The contract of losses."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Mapping
from copy import deepcopy
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, ClassVar, Literal, TypeVar

import torch
from torch import Tensor, nn

from brushexp.bounds import at_least
from brushexp.pictures.focus import resized
from brushexp.pictures.region import Region
from brushexp.strokes.catalogue import Strokes

T = TypeVar("T")


@dataclass(frozen=True)
class PaintedView:
    """The view of a step once it is painted: everything that a loss may read."""

    image: Tensor  # (3, h, w) the painting where this step looks, display-referred RGB in [0, 1]
    target: Tensor  # (3, h, w); the same object as long as steps look at the same place
    strokes: Strokes  # all N strokes of the painting; those that this step does not move have no gradient
    surroundings: Surroundings | None = None  # the canvas around it; None if ``image`` is all of the canvas
    focus: Tensor | None = None  # (h, w) weights of the pixels, of mean 1 over the whole canvas; None for equal ones

    @property
    def whole_target(self) -> Tensor:
        """(3, H, W) target of the whole canvas; the same object at every step."""
        return self.target if self.surroundings is None else self.surroundings.target

    @property
    def share(self) -> float:
        """``image``'s share of the pixels of the canvas."""
        return self.image[0].numel() / self.whole_target[0].numel()

    def weights(self, values: Tensor) -> Tensor | None:
        """Resize ``focus`` (h, w) to values (..., h, w), such as features; None for equal weights."""
        return None if self.focus is None else resized(self.focus, (values.shape[-2], values.shape[-1]))

    def mean(self, values: Tensor) -> Tensor:
        """Average values (..., h, w) of pixels or features, weighted by ``focus``; 0 of no values."""
        weights = self.weights(values) if values.numel() else None
        return (values if weights is None else values * weights).sum() / max(values.numel(), 1)

    def around(self, context: int, grid: int = 1) -> PaintedView:
        """Widen the view by ``context`` pixels of the canvas on every side, which have no gradient."""
        if self.surroundings is None or not context:
            return self
        wide = self.surroundings.widened(context, grid)
        image = wide.paste(self.image, self.surroundings.region)
        return replace(self, image=image, target=wide.part, focus=wide.part_focus, surroundings=wide)


@dataclass(frozen=True, eq=False)
class Surroundings:
    """The canvas around the region that a step looks at; one object for all steps that look at the same place."""

    region: Region  # where the step looks
    picture: Tensor  # (3, H, W) the whole picture as it was last painted, without gradient
    target: Tensor  # (3, H, W) the whole target
    focus: Tensor | None = None  # (H, W) weights of its pixels; None for equal ones
    core: Region | None = None  # the part of the region that steps change; None for all of it
    part: Tensor = field(init=False)  # (3, h, w) the target in the region
    part_focus: Tensor | None = field(init=False)  # (h, w) the focus there
    _wider: dict[tuple[int, int], Surroundings] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "part", self.region.of(self.target).contiguous())
        object.__setattr__(self, "part_focus", None if self.focus is None else self.region.of(self.focus))

    def widened(self, context: int, grid: int) -> Surroundings:
        """Widen the region by ``context`` pixels; the same arguments return the same object."""
        if (context, grid) not in self._wider:
            region = self.region.widened(context, (self.picture.shape[1], self.picture.shape[2]), grid)
            self._wider[context, grid] = replace(self, region=region, core=self.core or self.region, _wider={})
        return self._wider[context, grid]

    def paste(self, image: Tensor, place: Region) -> Tensor:
        """Copy the region as it was last painted, with ``image`` (3, h, w) at a ``place`` of the canvas inside it."""
        picture = self.region.of(self.picture).to(image.dtype, copy=True)
        inside = replace(place, top=place.top - self.region.top, left=place.left - self.region.left)
        inside.of(picture).copy_(image)
        return picture


class Loss(nn.Module, ABC):
    """A term of the objective, with the facts that users choose by as class attributes.

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

    It ``looks_at`` pixels: the value is a mean over the pixels of ``view.image``, weighted by the focus, and a part
    of the canvas counts by its share of the pixels; at the canvas: the value is that of the whole canvas, by
    ``view.surroundings``; or at strokes: it has no gradient in the picture. The last two ignore the focus. With
    ``context`` it receives a part with so many pixels around it, from multiples of ``grid`` pixels on: the distance of
    a network's positions.

    Args:
        weight: factor in the sum of losses; logs show the loss without it.
    """

    tunable: ClassVar[dict[str, Any]] = {"weight": Annotated[float, at_least(0)]}  # an option of every loss
    weight: float = 1.0  # its default
    label: str = ""  # its name in logs, if not that of the plugin
    looks_at: ClassVar[Literal["pixels", "canvas", "strokes"]] = "pixels"
    cost: ClassVar[str] = ""  # cost of a step with this loss alone, in steps of ``mse`` (benchmarks/losses.py)
    exact_on_parts: ClassVar[bool] = True  # whether the gradient on a part of the canvas is that of the whole
    context: int = 0
    grid: int = 1

    def __init__(self) -> None:
        super().__init__()
        self._target: Tensor | None = None  # the last one of `of_target`
        self._results: dict[Hashable, Any] = {}  # results for that target, by key

    @abstractmethod
    def forward(self, view: PaintedView) -> Tensor:
        """Return a scalar, 0 for a perfect painting."""

    def of_target(self, target: Tensor, compute: Callable[[Tensor], T], key: Hashable = None) -> T:
        """Return ``compute(target)`` without gradient, cached by ``key`` until another target comes."""
        if target is not self._target:  # a reference to the object, so that its identity cannot be reused
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
    """A loss that compares a painting with the picture of another one."""

    colors: str  # style: the target takes the colours of the style picture; content: that takes those of the target

    @abstractmethod
    def check(self, size: tuple[int, int]) -> int:
        """Return the longer side of the style picture for a canvas of ``size`` (H, W); a UserError if too small."""

    @abstractmethod
    def picture(self, target: Tensor) -> Tensor:
        """Load the style picture (3, h, w) for a whole target (3, H, W)."""

    @abstractmethod
    def measure(self, picture: Tensor, target: Tensor) -> dict[str, float]:
        """Measure the distances of a picture (3, H, W) from the style, by their names."""


class BrushworkLoss(Loss):
    """A loss that compares the strokes of a painting with those of another one."""

    @abstractmethod
    def arranged(self, strokes: Strokes, size: tuple[int, int], generator: torch.Generator) -> Strokes:
        """Give first strokes on a canvas of ``size`` (H, W), in place and colour, the shapes of the other painting."""


def state_of(losses: Mapping[str, Loss]) -> dict[str, dict[str, Any]]:
    """Copy the states of losses, by name."""
    return {name: deepcopy(loss.state_dict()) for name, loss in losses.items()}


def restore(losses: Mapping[str, Loss], state: Mapping[str, Mapping[str, Any]]) -> None:
    """Load the states that `state_of` gave."""
    for name, loss in losses.items():
        loss.load_state_dict(state[name])


def weighted_sum(losses: Mapping[str, Loss], view: PaintedView) -> tuple[Tensor, dict[str, Tensor]]:
    """Compute the objective, the weighted sum of the losses, and each of them unweighted."""
    terms, weighted = {}, []
    for name, loss in losses.items():
        wider = view.around(loss.context, loss.grid)
        terms[name] = loss(wider)
        weighted.append(loss.weight * (wider.share if loss.looks_at == "pixels" else 1) * terms[name])
    return torch.stack(weighted).sum(), terms
