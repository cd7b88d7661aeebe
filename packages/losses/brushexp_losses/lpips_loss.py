"""The LPIPS perceptual distance as a loss."""

from typing import Annotated

from torch import Tensor

from brushexp.contracts import FILE, one_of, register
from brushexp.contracts.families import Loss, PaintedView
from brushexp_losses.calibrated import CALIBRATED, open_distance


@register("loss", "lpips")
class Lpips(Loss):
    """LPIPS perceptual distance (Zhang et al.) between painting and target, in the feature space of a network.

    Source: Zhang et al., 2018, arXiv:1801.03924. With alexnet, squeeze or vgg16, the loss uses the published weights
    and is logged as lpips-alexnet and so on. Unlike in the source, the default backbone ``effl0`` has one weight for
    all channels of an activation.

    Args:
        weight: factor in the sum of losses. With the default, the gradient with respect to the picture has about the
            same norm as that of ``mse`` (256-pixel pictures, blurred by two pixels); alexnet needs 0.0025 for this, and
            squeeze 0.0015. Added to ``mse``, the default cost less than 0.1 dB of PSNR and reduced the distance by a
            fifth to a quarter.
        backbone: feature network: effl0, or one of alexnet, squeeze and vgg16, which need ``weights``.
        weights: file with the weights of the network's feature layers, under torchvision's names.
    """

    weight = 0.0012
    cost = "5.9 x mse"
    exact_on_parts = False

    def __init__(
        self,
        *,
        backbone: Annotated[str, one_of("effl0", *CALIBRATED)] = "effl0",
        weights: Annotated[str | None, FILE] = None,
    ) -> None:
        super().__init__()
        self.distance = open_distance(backbone, weights)
        self.label = self.distance.label
        self.context, self.grid = self.distance.network.context, self.distance.network.grid

    def forward(self, view: PaintedView) -> Tensor:
        theirs, ours = self.of_target(view.target, self.distance.look), self.distance.look(view.image)
        return self.distance.compare(ours, theirs, [view.weights(value) for value in ours])
