"""What every loss receives and returns."""

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
    """What a step's view shows once it is painted: everything that a loss may look at."""

    image: Tensor  # (3, h, w) the painting where this step looks, display-referred RGB in [0, 1]
    target: Tensor  # (3, h, w) what it should look like; the same object as long as steps look at the same place
    strokes: Strokes  # all N strokes of the painting; those that this step does not move have no gradient
    surroundings: Surroundings | None = None  # the canvas around it; None if ``image`` is all of the canvas
    focus: Tensor | None = None  # (h, w) how much each pixel counts, of mean 1 over the whole canvas; None: all alike

    @property
    def whole_target(self) -> Tensor:
        """(3, H, W) what the whole canvas should look like; the same object at every step."""
        return self.target if self.surroundings is None else self.surroundings.target

    @property
    def share(self) -> float:
        """``image``'s share of the pixels of the canvas: 1 for all of it."""
        return self.image[0].numel() / self.whole_target[0].numel()

    def weights(self, values: Tensor) -> Tensor | None:
        """``focus`` (h, w) at the resolution of values (..., h, w), features for instance; None if all count alike."""
        return None if self.focus is None else resized(self.focus, (values.shape[-2], values.shape[-1]))

    def mean(self, values: Tensor) -> Tensor:
        """Mean of values (..., h, w) of the pixels, or of features, weighted by ``focus``; 0 of no values."""
        weights = self.weights(values) if values.numel() else None
        return (values if weights is None else values * weights).sum() / max(values.numel(), 1)

    def around(self, context: int, grid: int = 1) -> PaintedView:
        """The same with ``context`` more pixels on every side, as far as there is canvas; those have no gradient."""
        if self.surroundings is None or not context:
            return self
        wide = self.surroundings.widened(context, grid)
        image = wide.pasted(self.image, self.surroundings.region)
        return replace(self, image=image, target=wide.part, focus=wide.part_focus, surroundings=wide)


@dataclass(frozen=True, eq=False)
class Surroundings:
    """The canvas around the region that a step looks at; one object for all steps that look at the same place."""

    region: Region  # where the step looks
    picture: Tensor  # (3, H, W) the whole picture as it was last seen, without gradient
    target: Tensor  # (3, H, W) the whole target
    focus: Tensor | None = None  # (H, W) how much each of its pixels counts; None if all count alike
    core: Region | None = None  # the part of the region in which steps change the picture; None for all of it
    part: Tensor = field(init=False)  # (3, h, w) the target in the region
    part_focus: Tensor | None = field(init=False)  # (h, w) the focus there
    _wider: dict[tuple[int, int], Surroundings] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "part", self.region.of(self.target).contiguous())
        object.__setattr__(self, "part_focus", None if self.focus is None else self.region.of(self.focus))

    def widened(self, context: int, grid: int) -> Surroundings:
        """Those of the region with ``context`` pixels around it; the same object whenever it is asked for."""
        if (context, grid) not in self._wider:
            region = self.region.widened(context, (self.picture.shape[1], self.picture.shape[2]), grid)
            self._wider[context, grid] = replace(self, region=region, core=self.core or self.region, _wider={})
        return self._wider[context, grid]

    def pasted(self, image: Tensor, place: Region) -> Tensor:
        """The region as it was last seen, with ``image`` (3, h, w) at a ``place`` of the canvas inside it."""
        found = self.region.of(self.picture).to(image.dtype, copy=True)
        inside = replace(place, top=place.top - self.region.top, left=place.left - self.region.left)
        inside.of(found).copy_(image)
        return found


class Loss(nn.Module, ABC):
    """One term of the objective.

    A subclass states what a user chooses by, in class attributes; `facts` puts them into words.

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
    of the canvas counts by its share of the pixels; at the canvas: the value is one of the whole canvas, which the loss
    looks at through ``view.surroundings``; or at strokes: it has no gradient in the picture. The last two leave the
    focus aside. With ``context`` it receives a part of the canvas with so many pixels around it, which begins at
    multiples of ``grid`` pixels: those that a network's positions are apart.

    Args:
        weight: factor in the sum of losses; logs show the loss without it.
    """

    tunable: ClassVar[dict[str, Any]] = {"weight": Annotated[float, at_least(0)]}  # an option of every loss
    weight: float = 1.0  # its default
    label: str = ""  # what logs call it; "" for the name it was chosen by
    looks_at: ClassVar[Literal["pixels", "canvas", "strokes"]] = "pixels"
    cost: ClassVar[str] = ""  # of a step with this loss alone, in steps of ``mse`` (benchmarks/losses.py)
    exact_on_parts: ClassVar[bool] = True  # whether the gradient on a part of the canvas is that of the whole there
    context: int = 0
    grid: int = 1

    def __init__(self) -> None:
        super().__init__()
        self._target: Tensor | None = None  # the last one that `of_target` was asked about
        self._found: dict[Hashable, Any] = {}  # and what was computed from it

    @abstractmethod
    def forward(self, view: PaintedView) -> Tensor:
        """Return a scalar, 0 for a perfect painting."""

    def of_target(self, target: Tensor, compute: Callable[[Tensor], T], key: Hashable = None) -> T:
        """``compute(target)`` without gradient, kept until another target comes; ``key`` tells computations apart."""
        if target is not self._target:  # the object is kept, so that its identity cannot be reused
            self._target, self._found = target, {}
        if key not in self._found:
            with torch.no_grad():
                self._found[key] = compute(target)
        return self._found[key]

    @classmethod
    def facts(cls) -> dict[str, str]:
        return {
            "cost": cls.cost or "not measured",
            "gradient": "strokes only" if cls.looks_at == "strokes" else "picture",
            "on parts of the canvas": "exact" if cls.exact_on_parts else "approximate",
            "focus": "honoured" if cls.looks_at == "pixels" else "ignored",
        }


def state_of(losses: Mapping[str, Loss]) -> dict[str, dict[str, Any]]:
    """A copy of what losses remember from one call to the next, and of what they have learnt, by name."""
    return {name: deepcopy(loss.state_dict()) for name, loss in losses.items()}


def restore(losses: Mapping[str, Loss], state: Mapping[str, Mapping[str, Any]]) -> None:
    """Let losses go on from what `state_of` gave."""
    for name, loss in losses.items():
        loss.load_state_dict(state[name])


def weighted_sum(losses: Mapping[str, Loss], view: PaintedView) -> tuple[Tensor, dict[str, Tensor]]:
    """The objective: the sum of the losses times their weights, and each of them unweighted."""
    terms, weighted = {}, []
    for name, loss in losses.items():
        wider = view.around(loss.context, loss.grid)
        terms[name] = loss(wider)
        weighted.append(loss.weight * (wider.share if loss.looks_at == "pixels" else 1) * terms[name])
    return torch.stack(weighted).sum(), terms
