"""The loss in the form of LPIPS."""

from torch import Tensor

from brushexp.features import distance
from brushexp.plugins.loss.base import Loss, Painting
from brushexp.registry import register


@register("loss", "lpips")
class Lpips(Loss):
    """LPIPS perceptual distance (Zhang et al.) between painting and target, in the features of a network.

    Source: Zhang et al., 2018, arXiv:1801.03924. With alexnet, squeeze or vgg16 it is that distance, with its published
    weights, and logs call it lpips-alexnet and so on. Differs from it by default: ``effl0``, the network that is always
    there, has one weight for all channels of an activation; logs call it effl0.

    Args:
        weight: factor in the sum of losses. With the default, the gradient in the picture is about as long as that of
            ``mse`` for pictures of 256 pixels blurred by two (0.0011 and 0.0013 by measurement). For alexnet the same
            balance is at 0.0025, for squeeze at 0.0015. Beside ``mse`` it cost less than 0.1 dB of PSNR and took a
            fifth to a quarter off the distance (150 steps, two pictures of 160 pixels).
        backbone: feature network: effl0, or alexnet, squeeze or vgg16 (need ``weights``).
        weights: file with the network's features, under torchvision's names.
    """

    cost = "5.9 x mse"
    exact_on_parts = False

    def __init__(self, *, weight: float = 0.0012, backbone: str = "effl0", weights: str | None = None) -> None:
        super().__init__(weight)
        self.distance = distance.open_distance(backbone, weights)
        self.label = self.distance.label
        self.context, self.grid = self.distance.network.context, self.distance.network.grid

    def forward(self, painting: Painting) -> Tensor:
        wanted = self.of_target(painting.target, self.distance.look)
        seen = self.distance.look(painting.image)
        return self.distance.compare(seen, wanted, [painting.weights(value) for value in seen])
