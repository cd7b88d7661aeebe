"""What every blend receives and returns."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from brushexp.compositing.layers import Layers, Size
from brushexp.plugins.color.base import ColorSpace


@dataclass(frozen=True)
class Canvas:
    """A picture: ``image`` (3, H, W), display-referred RGB; ``accuracy`` (N,), without gradient, if a target was given.

    Accuracy is as ``order.base.Order.depth`` defines it, NaN for a stroke that covers nothing here.
    """

    image: Tensor
    accuracy: Tensor | None = None


class Blend(ABC):
    """Lays strokes over each other: out = sum_n a_n c_n prod_{i above n} (1 - a_i), plus the background.

    >>> from brushexp.registry import build_named
    >>> from brushexp.strokes.prior import sample_prior
    >>> layers = build_named("renderer", "analytic", {})(sample_prior(2))
    >>> blend = build_named("blend", "dense", {})
    >>> blend(layers, torch.tensor([1, 0]), (16, 24), torch.ones(3)).image.shape  # stroke 1 lies on stroke 0
    torch.Size([3, 16, 24])
    """

    cost: ClassVar[str] = "not measured"  # of a gradient step against that of ``tiled``, at 1024 px and 10,000 strokes
    exact: ClassVar[str] = "yes"  # or what it leaves out
    runs_on: ClassVar[str] = "any device, any precision"
    space: ColorSpace | None = None  # in which paint is laid over paint, see `compositing.mixing`; None for RGB
    layered: bool = True  # whether strokes laid over others look as if both had been laid at once

    @property
    def plain(self) -> "Blend":
        """The blend that lays channels as they come, whatever they mean; ``background`` and picture have them, too."""
        return self

    @classmethod
    def facts(cls) -> dict[str, str]:
        return {"cost": cls.cost, "exact": cls.exact, "runs on": cls.runs_on}

    def check(self, count: int, size: Size) -> None:  # noqa: B027  (most hold anything)
        """Refuse (UserError) ``count`` strokes on a canvas of ``size`` (H, W) if it cannot hold them."""

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
        """By how much the squared error would grow without each of the N strokes; None if it has no quick way to tell.

        Arguments as above; ``weight`` (H, W) says how much the error at each pixel counts in the sum.
        """
        return None


def accuracy_of(error: Tensor, total: Tensor) -> Tensor:
    """Accuracy (N,) from the sums (N,) of alpha |color - target|^2 and of alpha; NaN where a stroke covers nothing."""
    covers = total > 1e-6  # below a millionth of a pixel there is nothing to judge
    return torch.where(covers, 1 - error / total.clamp_min(1e-6), torch.nan)


def alike(layers: Layers, background: Tensor, target: Tensor | None) -> tuple[Tensor, Tensor | None]:
    """Background and target in the precision of the layers, which says in which one a picture is computed."""
    return background.to(layers.color.dtype), None if target is None else target.to(layers.color.dtype)


def pixel_centres(pixel: Tensor, width: int, dtype: torch.dtype) -> Tensor:
    """Positions (..., 2), x and y, of pixels (...) numbered row by row on a canvas ``width`` pixels wide."""
    return torch.stack([pixel % width, pixel // width], dim=-1).to(dtype) + 0.5
