"""LPIPS as a metric: a calibrated distance in feature space."""

from typing import Annotated

from brushexp.contracts import FILE, one_of, register
from brushexp.contracts.families import Comparison, Metric
from brushexp_losses.calibrated import CALIBRATED, open_distance


@register("metric", "lpips")
class OfficialLpips(Metric):
    """LPIPS (Zhang et al., 2018) with its published weights, on the features of a network loaded from a file.

    With the backbone ``effl0``, this metric equals ``perceptual``.

    Args:
        option: key that sets the file, to be named in error messages.
        backbone: feature network: effl0, or one of alexnet, squeeze and vgg16, which need ``weights``.
        weights: file with the weights of the network's feature layers, under torchvision's names.
    """

    title = "LPIPS"
    variants = {  # noqa: RUF012
        "lpips_alexnet": "LPIPS (AlexNet)", "lpips_squeeze": "LPIPS (SqueezeNet)", "lpips_vgg16": "LPIPS (VGG16)",
    }  # fmt: skip
    higher_is_better = False
    matters = 0.005

    def __init__(
        self,
        option: str = "metric.lpips.weights",
        *,
        backbone: Annotated[str, one_of("effl0", *CALIBRATED)] = "effl0",
        weights: Annotated[str | None, FILE] = None,
    ) -> None:
        self.distance = open_distance(backbone, weights, option)
        self.label = self.distance.label.replace("-", "_")

    def __call__(self, comparison: Comparison) -> float:
        return float(self.distance(comparison.image, comparison.target))
