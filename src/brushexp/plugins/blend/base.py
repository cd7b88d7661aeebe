"""The contract of blends, which lay strokes over each other."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch import Tensor

from brushexp.compositing.layers import Canvas, Layers, Size
from brushexp.plugins.color.base import ColorSpace


class Blend(ABC):
    """Lays strokes over each other: out = sum_n a_n c_n prod_{i above n} (1 - a_i), plus the background.

    >>> from brushexp.registry import build_named
    >>> from brushexp.strokes.prior import sample_prior
    >>> layers = build_named("renderer", "analytic", {})(sample_prior(2))
    >>> blend = build_named("blend", "dense", {})
    >>> blend(layers, torch.tensor([1, 0]), (16, 24), torch.ones(3)).image.shape  # stroke 1 lies on stroke 0
    torch.Size([3, 16, 24])
    """

    cost: ClassVar[str] = "not measured"  # time of a step, that of ``tiled`` being 1, at 1024 px and 10,000 strokes
    exact: ClassVar[str] = "yes"  # or what it leaves out
    runs_on: ClassVar[str] = "any device, any precision"
    layered: ClassVar[bool] = True  # whether strokes laid over others look as if both had been laid at once

    @classmethod
    def facts(cls) -> dict[str, str]:
        return {"cost": cls.cost, "exact": cls.exact, "runs on": cls.runs_on}

    def check(self, count: int, size: Size) -> None:  # noqa: B027  (most hold anything)
        """Raise a UserError if the blend cannot hold ``count`` strokes on a canvas of ``size`` (H, W)."""

    @abstractmethod
    def __call__(
        self, layers: Layers, front_to_back: Tensor, size: Size, background: Tensor, target: Tensor | None = None
    ) -> Canvas:
        """Paint ``layers`` on a canvas of ``size`` (H, W), differentiable in every tensor of ``layers``.

        Args:
            layers: of N strokes.
            front_to_back: (N,) their indices, the uppermost first.
            size: height and width in pixels; pixel (row, column) lies at (column + 0.5, row + 0.5).
            background: (3,) colour of the bare canvas; the picture has the precision of ``layers``, not of this.
            target: (3, H, W); if given, ``accuracy`` is measured against it in the same pass.
        """

    def importance(
        self, layers: Layers, front_to_back: Tensor, size: Size, background: Tensor, target: Tensor, weight: Tensor
    ) -> Tensor | None:
        """Compute by how much (N,) the squared error grows without each stroke; None if there is no quick way.

        Arguments as above; ``weight`` (H, W) says how much the error at each pixel counts in the sum.
        """
        return None


@dataclass(frozen=True)
class Compositor:
    """Lays strokes over each other in a colour space: encodes their colours, blends, and decodes the picture.

    The accuracy of a stroke is that of its own colour, which no other is laid over: it is the same in every space. Of
    its importance nothing is known in other spaces than RGB: the error of their channels ranks strokes otherwise.
    """

    blend: Blend
    space: ColorSpace

    def __call__(
        self, layers: Layers, front_to_back: Tensor, size: Size, background: Tensor, target: Tensor | None = None
    ) -> Canvas:
        if self.space.is_rgb:
            return self.blend(layers, front_to_back, size, background, target)
        bare = self.space.encode(background.to(layers.color))
        channels = self.blend(layers.encoded(self.space.encode), front_to_back, size, bare).image
        image = self.space.decode(channels)
        if target is None:
            return Canvas(image)
        with torch.no_grad():
            return Canvas(image, self.blend(layers, front_to_back, size, background, target).accuracy)

    def importance(self, *arguments: Any) -> Tensor | None:
        return self.blend.importance(*arguments) if self.space.is_rgb else None


def match_dtype(layers: Layers, background: Tensor, target: Tensor | None) -> tuple[Tensor, Tensor | None]:
    """Bring background and target to the precision of the layers, in which a picture is computed."""
    return background.to(layers.color.dtype), None if target is None else target.to(layers.color.dtype)


def pixel_centres(pixel: Tensor, width: int, dtype: torch.dtype) -> Tensor:
    """Compute positions (..., 2), x and y, of pixels (...) numbered row by row on a canvas ``width`` pixels wide."""
    return torch.stack([pixel % width, pixel // width], dim=-1).to(dtype) + 0.5
