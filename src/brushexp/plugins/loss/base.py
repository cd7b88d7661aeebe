"""What every loss receives and returns."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace

import torch
from torch import Tensor, nn

from brushexp.features.sight import aligned
from brushexp.pictures.region import Region
from brushexp.strokes.catalogue import Strokes


@dataclass(frozen=True)
class Painting:
    """Everything a loss may look at after one forward pass.

    Attributes:
        image: (3, h, w) the painting where this step looks, display-referred RGB in [0, 1].
        target: (3, h, w) what it should look like, same units; the same tensor object as long as steps look at the same
            place.
        strokes: all N strokes of the painting; those that this step does not move have no gradient.
        surroundings: the canvas around it; None if ``image`` is all of the canvas.
        focus: (h, w) how much each pixel of ``image`` counts, with a mean of 1 over the whole canvas; None if all count
            alike. The same object as long as steps look at the same place. See `mean` and `weighted`.
    """

    image: Tensor
    target: Tensor
    strokes: Strokes
    surroundings: Surroundings | None = None
    focus: Tensor | None = None

    @property
    def whole_target(self) -> Tensor:
        """(3, H, W) what the whole canvas should look like; the same object at every step."""
        return self.target if self.surroundings is None else self.surroundings.target

    @property
    def whole_focus(self) -> Tensor | None:
        """(H, W) how much each pixel of the whole canvas counts; the same object at every step."""
        return self.focus if self.surroundings is None else self.surroundings.focus

    @property
    def share(self) -> float:
        """Of the canvas's pixels, those that ``image`` shows: 1 for all."""
        return self.image[0].numel() / self.whole_target[0].numel()

    def weighted(self, values: Tensor) -> Tensor:
        """Values (..., h, w) of the pixels of ``image``, each times how much its pixel counts."""
        return values if self.focus is None else values * self.focus

    def mean(self, values: Tensor) -> Tensor:
        """Mean of values (..., h, w) of the pixels of ``image``, each pixel as much as it counts.

        Times ``share``, those of the parts of a canvas add up to that of the whole.
        """
        return self.weighted(values).mean()

    def around(self, margin: int, grid: int = 1) -> Painting:
        """The same with ``margin`` more pixels on every side, as far as there is canvas; those have no gradient.

        What a loss makes of a pixel may depend on others, as features do. Of each pixel of a part, everything that
        depends on it is seen as in the whole picture if the margin is twice as wide as such a thing sees to one side.
        To count as there, what is summed over the wider picture is divided by the pixels of the part.

        Args:
            margin: pixels.
            grid: of a network that looks in steps of so many pixels: a little more is shown, so that its steps fall on
                the same pixels as in the whole picture. See `features.sight`, which tells margin and grid.
        """
        if self.surroundings is None:
            return self
        image, target, focus = self.surroundings.frame(self.image, margin, grid)
        return replace(self, image=image, target=target, focus=focus)


@dataclass(frozen=True)
class Surroundings:
    """The canvas around the region that a step looks at; one object for all steps that look at the same place.

    Attributes:
        region: where the step looks.
        picture: (3, H, W) the whole picture as it was last seen, without gradient.
        target: (3, H, W) the whole target.
        focus: (H, W) how much each of its pixels counts; None if all count alike.
    """

    region: Region
    picture: Tensor
    target: Tensor
    focus: Tensor | None = None
    # Target and focus by margin and grid, so that a loss meets the same objects again.
    _wanted: dict[tuple[int, int], tuple[Tensor, Tensor | None]] = field(default_factory=dict)

    def wide(self, margin: int, grid: int = 1) -> Region:
        """The region that `Painting.around` shows."""
        return aligned(self.region, (self.picture.shape[1], self.picture.shape[2]), margin, margin, grid)

    def frame(self, image: Tensor, margin: int, grid: int = 1) -> tuple[Tensor, Tensor, Tensor | None]:
        """Picture, target and focus of the wider region, with ``image`` (3, h, w) in the region itself."""
        region, wide = self.region, self.wide(margin, grid)
        if (margin, grid) not in self._wanted:
            focus = None if self.focus is None else wide.of(self.focus)
            self._wanted[margin, grid] = (wide.of(self.target).contiguous(), focus)
        top, left = region.top - wide.top, region.left - wide.left
        rows, columns = slice(top, top + region.height), slice(left, left + region.width)
        mask = torch.zeros(wide.height, wide.width, dtype=torch.bool, device=image.device)
        mask[rows, columns] = True
        padding = (left, wide.width - left - region.width, top, wide.height - top - region.height)
        seen = nn.functional.pad(image, padding)
        return torch.where(mask, seen, wide.of(self.picture)), *self._wanted[margin, grid]


class Loss(nn.Module, ABC):
    """One term of the objective. ``weight`` scales it in the sum; logs show it unweighted.

    Attributes:
        weight: factor in the sum.
        label: what logs call it; "" for the name it was chosen by.
        over_pixels: whether the value is a mean over the pixels that it is shown; the painter then counts a part of the
            canvas by its share of it, and pixels count as the painting's focus says. False for what looks at all
            strokes or at the whole canvas; that leaves the focus aside.
    """

    weight: float
    label: str = ""
    over_pixels: bool = True

    @abstractmethod
    def forward(self, painting: Painting) -> Tensor:
        """Return a scalar, 0 for a perfect painting."""
