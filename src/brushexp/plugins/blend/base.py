"""Base class for blends, which composite strokes."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch import Tensor

from brushexp.compositing.layers import Canvas, Layers, Size
from brushexp.plugins.color.base import ColorSpace


class Blend(ABC):
    """Composites strokes over a background: out = sum_n a_n c_n prod_{i above n} (1 - a_i) + background term.

    >>> from brushexp.registry import build_named
    >>> from brushexp.strokes.prior import sample_prior
    >>> layers = build_named("renderer", "analytic", {})(sample_prior(2))
    >>> blend = build_named("blend", "dense", {})
    >>> blend(layers, torch.tensor([1, 0]), (16, 24), torch.ones(3)).image.shape  # stroke 1 lies on stroke 0
    torch.Size([3, 16, 24])
    """

    cost: ClassVar[str] = "not measured"  # time of a step relative to ``tiled``, at 1024 px and 10,000 strokes
    exact: ClassVar[str] = "yes"  # "yes", or what the blend leaves out
    runs_on: ClassVar[str] = "any device, any precision"
    layered: ClassVar[bool] = True  # whether compositing in two passes gives the same picture as in one

    @classmethod
    def facts(cls) -> dict[str, str]:
        return {"cost": cls.cost, "exact": cls.exact, "runs on": cls.runs_on}

    def check(self, count: int, size: Size) -> None:  # noqa: B027  (most hold anything)
        """Raise a UserError if ``count`` strokes on a canvas of ``size`` (H, W) need too much memory."""

    @abstractmethod
    def __call__(
        self, layers: Layers, front_to_back: Tensor, size: Size, background: Tensor, target: Tensor | None = None
    ) -> Canvas:
        """Paint ``layers`` on a canvas of ``size`` (H, W), differentiable in every tensor of ``layers``.

        Args:
            layers: layers of N strokes.
            front_to_back: (N,) indices of the strokes, top stroke first.
            size: height and width in pixels; pixel (row, column) is centred at (column + 0.5, row + 0.5).
            background: (3,) colour of the bare canvas; the picture has the dtype of ``layers``, not of the background.
            target: (3, H, W); if given, ``accuracy`` is measured against it in the same pass.
        """

    def importance(
        self, layers: Layers, front_to_back: Tensor, size: Size, background: Tensor, target: Tensor, weight: Tensor
    ) -> Tensor | None:
        """Compute the increase (N,) in squared error if each stroke is removed; None if there is no fast method.

        The arguments are the same as those of ``__call__``; ``weight`` (H, W) weights the error at each pixel.
        """
        return None


@dataclass(frozen=True)
class Compositor:
    """Composites strokes in a colour space: encodes the stroke colours, blends the strokes, and decodes the picture.

    The accuracy of a stroke refers to its own colour, not to composited colours, so it is the same in every space.
    Importance is computed only in RGB, because errors in other channels rank strokes differently.
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
    """Convert the background and the target to the dtype of the layers, in which the picture is computed."""
    return background.to(layers.color.dtype), None if target is None else target.to(layers.color.dtype)


def pixel_centres(pixel: Tensor, width: int, dtype: torch.dtype) -> Tensor:
    """Compute the centres (..., 2: x, y) of pixels, given as row-major indices (...), on a canvas of this ``width``."""
    return torch.stack([pixel % width, pixel // width], dim=-1).to(dtype) + 0.5
