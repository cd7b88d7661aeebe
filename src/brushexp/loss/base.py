"""What every loss receives and returns."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace

import torch
from torch import Tensor, nn

from brushexp.sampler.base import Region
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
    """

    image: Tensor
    target: Tensor
    strokes: Strokes
    surroundings: Surroundings | None = None

    def around(self, margin: int) -> Painting:
        """The same with ``margin`` more pixels on every side, as far as there is canvas; those have no gradient.

        What a loss makes of a pixel may depend on others, as features do. With a margin as wide as its field of view,
        the pixels of a part count as they would in the whole picture.
        """
        if self.surroundings is None:
            return self
        image, target = self.surroundings.frame(self.image, margin)
        return replace(self, image=image, target=target)


@dataclass(frozen=True)
class Surroundings:
    """The canvas around the region that a step looks at; one object for all steps that look at the same place.

    Attributes:
        region: where the step looks.
        picture: (3, H, W) the whole picture as it was last seen, without gradient.
        target: (3, H, W) the whole target.
    """

    region: Region
    picture: Tensor
    target: Tensor
    _targets: dict[int, Tensor] = field(default_factory=dict)  # by margin, so that a loss meets the same object again

    def frame(self, image: Tensor, margin: int) -> tuple[Tensor, Tensor]:
        """Picture and target of the region widened by ``margin``, with ``image`` (3, h, w) in the region itself."""
        region = self.region
        wide = region.widened(margin, (self.picture.shape[1], self.picture.shape[2]))
        if margin not in self._targets:
            self._targets[margin] = wide.of(self.target).contiguous()
        top, left = region.top - wide.top, region.left - wide.left
        rows, columns = slice(top, top + region.height), slice(left, left + region.width)
        mask = torch.zeros(wide.height, wide.width, dtype=torch.bool, device=image.device)
        mask[rows, columns] = True
        padding = (left, wide.width - left - region.width, top, wide.height - top - region.height)
        seen = nn.functional.pad(image, padding)
        return torch.where(mask, seen, wide.of(self.picture)), self._targets[margin]


class Loss(nn.Module, ABC):
    """One term of the objective. ``weight`` scales it in the sum; logs show it unweighted.

    Attributes:
        weight: factor in the sum.
        label: what logs call it; "" for the name it was chosen by.
    """

    weight: float
    label: str = ""

    @abstractmethod
    def forward(self, painting: Painting) -> Tensor:
        """Return a scalar, 0 for a perfect painting."""
