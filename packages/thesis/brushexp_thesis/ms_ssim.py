"""Multi-scale structural similarity (MS-SSIM), a metric often reported in papers on Gaussian image representations."""

from brushexp.contracts import register
from brushexp.contracts.families import Comparison, Metric

SMALLEST_SIDE = 176  # minimum side in pixels, at which a sixteenth still contains the window of 11 x 11


@register("metric", "ms_ssim")
class MultiscaleSimilarity(Metric):
    """MS-SSIM (Wang, Simoncelli and Bovik, 2003): SSIM at five scales, which is 1 for identical pictures.

    torchmetrics computes it in float64. It is undefined for pictures with a side below 176 pixels.
    """

    title = "MS-SSIM"
    higher_is_better = True
    matters = 0.003

    def __call__(self, comparison: Comparison) -> float | None:
        from torchmetrics.functional.image import (  # noqa: PLC0415  (--help does not need it)
            multiscale_structural_similarity_index_measure as similarity,
        )

        if min(comparison.target.shape[1:]) < SMALLEST_SIDE:
            return None
        image, target = (picture[None].double() for picture in (comparison.image, comparison.target))
        return float(similarity(image, target, data_range=1.0))
