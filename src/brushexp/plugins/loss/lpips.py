"""The loss in the form of LPIPS."""

from torch import Tensor

from brushexp.features import distance
from brushexp.plugins.loss._part import factors, framed, places
from brushexp.plugins.loss._target import OfTarget
from brushexp.plugins.loss.base import Loss, Painting
from brushexp.registry import register


@register("loss", "lpips")
class Lpips(Loss):
    """Perceptual distance: directions of deep features at several depths, as people judge (LPIPS).

    Source: Zhang et al., 2018, arXiv:1801.03924. With alexnet, squeeze or vgg16 it is that distance, with its published
    weights, and logs call it lpips-alexnet and so on. Differs from it by default: ``effl0``, the network that is always
    there, has one weight for all channels of an activation; logs call it effl0.

    On a part of the canvas, all features that see something of it count, with what surrounds them (effl0: 161 to 177
    pixels of it): times the part's share of the canvas, its gradient is that of the whole picture.

    Args:
        weight: factor in the sum of losses. With the default, the gradient in the picture is about as long as that of
            ``mse`` for pictures of 256 pixels blurred by two (0.0011 and 0.0013 by measurement). For alexnet the same
            balance is at 0.0025, for squeeze at 0.0015. Beside ``mse`` it cost less than 0.1 dB of PSNR and took a
            fifth to a quarter off the distance (150 steps, two pictures of 160 pixels).
        backbone: feature network: effl0, or alexnet, squeeze or vgg16 (need ``weights``).
        weights: file with the network's features, under torchvision's names.
    """

    def __init__(self, *, weight: float = 0.0012, backbone: str = "effl0", weights: str | None = None) -> None:
        super().__init__()
        self.weight = weight
        self.distance = distance.open_distance(backbone, weights)
        self.label = self.distance.label
        self._wanted: OfTarget[list[Tensor]] = OfTarget()
        self._places: OfTarget[Tensor] = OfTarget()  # focus of the positions of each tap

    def forward(self, painting: Painting) -> Tensor:
        network, taps = self.distance.network, self.distance.taps
        frame = framed(painting, network, taps)
        wanted = self._wanted.get(frame.target, self.distance.look)
        seen = self.distance.look(frame.image)
        at = places(painting, frame, seen, network, taps, self._places)
        return self.distance.compare(seen, wanted, factors(painting, frame, seen, network, taps), at)
