"""What every renderer receives and returns.

A renderer says what each stroke covers (`Layers`); a blend decides which pixels to ask and puts the answers together.
Two kinds: a profile renderer describes a stroke by its look in its own coordinates and is evaluated only where the
stroke is (`Profile`); a patch renderer draws the window of each stroke and samples it bilinearly.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass

from torch import Tensor, nn

from brushexp.strokes.bezier import closest_parameter, point_at
from brushexp.strokes.catalogue import Strokes


class Layers(ABC):
    """N strokes that know what they cover.

    Attributes:
        curve: (N, 3, 2) control points in pixels; all of a stroke lies within ``reach`` of its curve.
        reach: (N,) pixels beyond which its alpha is exactly 0; 0 or less for a stroke that is nowhere.
        color: (N, 3) mean colour.
    """

    curve: Tensor
    reach: Tensor
    color: Tensor

    @abstractmethod
    def sample(self, index: Tensor, points: Tensor) -> tuple[Tensor, Tensor]:
        """Ask strokes ``index`` (T, K) at ``points`` (T, P, 2), differentiable in the stroke parameters.

        Returns:
            alpha (T, K, P) in [0, 1] and color (T, K, P, 3), or (T, K, 1, 3) where it is constant.
        """


class Renderer(nn.Module, ABC):
    """Turns stroke parameters into layers."""

    @abstractmethod
    def forward(self, strokes: Strokes) -> Layers:
        """Layers on the canvas that ``strokes`` are measured on; differentiable in every field."""


@dataclass(frozen=True)
class Profile(Layers):
    """Strokes of one colour each, with round ends and a soft edge; what the compiled kernels draw.

    alpha = opacity * C(d), where d is the distance to the curve, h = half_width * (1 - taper * (2t - 1)^2) the half
    thickness at the nearest parameter t, and C(d) = S(h + d) + S(h - d) - 1 with the smooth step S of width ``soft``:
    the box of half width h smoothed by S, so that a line thinner than the edge fades instead of disappearing.

    Attributes:
        half_width: (N,) pixels.
        opacity: (N,).
        soft: width of the edge, pixels, > 0.
        taper: how much thinner the ends are, 0 (not) to 1 (pointed).
    """

    curve: Tensor
    half_width: Tensor
    color: Tensor
    opacity: Tensor
    soft: float
    taper: float

    @property
    def reach(self) -> Tensor:  # type: ignore[override]
        return self.half_width + 0.5 * self.soft

    def sample(self, index: Tensor, points: Tensor) -> tuple[Tensor, Tensor]:
        curve = self.curve[index][:, :, None]  # (T, K, 1, 3, 2)
        points = points[:, None]  # (T, 1, P, 2)
        t = closest_parameter(curve, points)  # (T, K, P)
        if not self.taper:
            t = t.detach()  # t is where the distance is least: to first order it does not matter
        offset = (point_at(curve, t) - points).square().sum(-1)
        distance = (offset + 1e-12 * (offset == 0)).sqrt()  # the slope at 0 is 0, not 0/0
        half = self.half_width[index][..., None] * (1 - self.taper * (2 * t - 1) ** 2)
        coverage = smooth_step((half + distance) / self.soft) + smooth_step((half - distance) / self.soft) - 1
        return self.opacity[index][..., None] * coverage, self.color[index][:, :, None]


def smooth_step(x: Tensor) -> Tensor:
    """Cubic step from 0 (x <= -1/2) to 1 (x >= 1/2)."""
    z = (x + 0.5).clamp(0, 1)
    return z * z * (3 - 2 * z)
