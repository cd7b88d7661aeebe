"""Structural similarity as a loss."""

import torch
from torch import Tensor
from torch.nn import functional

from brushexp.plugins.loss.base import Loss, PaintedView, at_least_single
from brushexp.registry import register

RADIUS, SIGMA = 5, 1.5  # pixels: the window has 11 x 11
C1, C2 = 0.01**2, 0.03**2  # of Wang et al., for pictures in [0, 1]


@register("loss", "ssim")
class StructuralSimilarity(Loss):
    """1 - SSIM (structural similarity, Wang et al.): compares local means, contrasts and structures.

    Source: Wang et al., 2004, with their Gaussian window of 11 x 11 pixels. As torchmetrics has it, windows at the
    border see the picture mirrored, and the channels are averaged. Differs from both: on a side of n < 6 pixels the
    window has 2 n - 1, so that any picture has a value; for one pixel only the means are compared. The value is
    computed from the difference of the pictures, which is exact where they are alike (equal ones: 0).

    Args:
        weight: factor in the sum of losses. With the default, the gradient in the picture is about as long as that of
            ``mse`` for pictures of 256 pixels blurred by two. Beside ``mse`` it raised SSIM by 0.02.
    """

    weight = 0.01
    cost = "3.1 x mse"
    context = 2 * RADIUS  # the windows that touch a part of the canvas, and all that they see

    def forward(self, view: PaintedView) -> Tensor:
        mean, variance = self.of_target(view.target, statistics)
        return view.mean(dissimilarity(view.image, view.target, mean, variance))


def statistics(picture: Tensor) -> tuple[Tensor, Tensor]:
    """Mean and variance (3, H, W) of the window around each pixel of a picture (3, H, W)."""
    picture = at_least_single(picture)
    mean, square = blurred(torch.cat([picture, picture.square()])).split(3)
    return mean, square - mean.square()


def dissimilarity(image: Tensor, target: Tensor, mean: Tensor, variance: Tensor) -> Tensor:
    """1 - SSIM (3, H, W) of the windows of two pictures (3, H, W); ``mean`` and ``variance`` are of the target's.

    With d the difference of the pictures, 2 m n = m^2 + n^2 - E[d]^2 for means m and n, and the same for covariances:
    SSIM = (1 - E[d]^2 / (m^2 + n^2 + C1)) (1 - V[d] / (V[x] + V[y] + C2)).
    """
    image, target = at_least_single(image), at_least_single(target)
    difference = image - target
    mean_d, square_d, square = blurred(torch.cat([difference, difference.square(), image.square()])).split(3)
    ours = mean + mean_d
    of_means = mean_d.square() / (ours.square() + mean.square() + C1)
    variance_d = (square_d - mean_d.square()).clamp_min(0)  # rounding may leave less
    of_structure = variance_d / (square - ours.square() + variance + C2)
    return of_means + of_structure - of_means * of_structure


def blurred(pictures: Tensor) -> Tensor:
    """Gaussian mean around each pixel of pictures (C, H, W), mirrored at the border."""
    count, (down, across) = len(pictures), (min(RADIUS, side - 1) for side in pictures.shape[1:])
    steps = (torch.arange(-r, r + 1).to(pictures) for r in (down, across))
    column, row = ((-((step / SIGMA) ** 2) / 2).softmax(0) for step in steps)
    mirrored = functional.pad(pictures[None], (across, across, down, down), mode="reflect")
    mirrored = mirrored.contiguous(memory_format=torch.channels_last)  # half the time or less
    narrower = functional.conv2d(mirrored, row.expand(count, 1, 1, -1), groups=count)
    return functional.conv2d(narrower, column[:, None].expand(count, 1, -1, -1), groups=count)[0]
