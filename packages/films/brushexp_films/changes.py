"""Detect motion, cuts and changes above codec noise in a film, and measure the flicker of its painting."""

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from brushexp.contracts.pictures import downsample

BLUR = 1.5  # pixels over which differences are averaged, since codec noise affects single pixels
GROWN = 2  # pixels by which a detected change is dilated to include half-covered pixels
CUT = 0.12  # mean difference between two small pictures, 0 to 1, above which there is a cut
CUT_SIDE = 16  # longer side of these pictures in pixels; motion or a panning camera hardly changes them
STILL = 0.02  # root mean square difference, 0 to 1, below which the target counts as unchanged in `Flicker`
FLOW_SIDE = 128  # longer side in pixels for optical flow, which takes hundredths of a second and suffices for strokes
FLOW_RADIUS = 5  # radius of its windows in pixels
WARPS = 3  # refinements per pyramid level


def difference(first: Tensor, second: Tensor) -> Tensor:
    """Compute the RMS difference (H, W) between pictures (3, H, W), over channels and a Gaussian of ``BLUR`` pixels."""
    from scipy.ndimage import gaussian_filter  # noqa: PLC0415  (slow to import)

    squares = (first - second).square().mean(0).cpu().numpy()
    return torch.from_numpy(np.sqrt(gaussian_filter(squares, BLUR).clip(0))).to(first.device)


def is_cut(first: Tensor, second: Tensor) -> bool:
    """Check whether two successive pictures (3, H, W) show different scenes."""
    return float((downsample(first, CUT_SIDE) - downsample(second, CUT_SIDE)).abs().mean()) > CUT


class Changes:
    """Finds the pixels of a film that have changed since they were last painted.

    Each pixel is compared with its value at its last change, so that slow fades are found and noise does not
    accumulate.
    """

    def __init__(self, threshold: float) -> None:
        self.threshold = threshold
        self.held = torch.empty(0)  # (3, H, W), each pixel as of its last change: the picture to paint
        self.begins = True  # whether the last picture began a scene
        self._last: Tensor | None = None

    def __call__(self, picture: Tensor) -> Tensor:
        """Mark the pixels (H, W) that have changed in the next picture (3, H, W); after a cut, mark all pixels."""
        self.begins = self._last is None or is_cut(self._last, picture)
        self._last = picture
        if self.begins:
            self.held = picture
            return torch.ones_like(picture[0], dtype=torch.bool)
        differs = (difference(picture, self.held) > self.threshold).float()
        changed = functional.max_pool2d(differs[None], 2 * GROWN + 1, 1, GROWN)[0] > 0
        self.held = torch.where(changed, picture, self.held)
        return changed


class Flicker:
    """Mean absolute change, 0 to 1, from one painted picture to the next where the target changes less than `STILL`."""

    def __init__(self) -> None:
        self._last: tuple[Tensor, Tensor] | None = None
        self._total, self._count = 0.0, 0

    def add(self, painting: Tensor, target: Tensor) -> None:
        """Add the next painted picture and its target, both (3, H, W) in [0, 1]."""
        if self._last is not None:
            still = difference(target, self._last[1]) < STILL
            change = (painting - self._last[0]).abs().mean(0)
            self._total += float(change[still].sum(dtype=torch.float64))
            self._count += int(still.sum())
        self._last = (painting, target)

    @property
    def value(self) -> float | None:
        """Flicker so far, or None if no pixel was still."""
        return self._total / self._count if self._count else None


def optical_flow(first: Tensor, second: Tensor) -> Tensor:
    """Estimate the displacement (2, H, W), right and down, of each pixel in ``first``.

    Source: Le Besnerais and Champagnat, 2005.
    """
    from skimage.registration import optical_flow_ilk  # noqa: PLC0415  (slow to import)

    small = [downsample(picture, FLOW_SIDE).mean(0).cpu().numpy() for picture in (first, second)]
    if min(small[0].shape) < 2 * FLOW_RADIUS:
        return torch.zeros_like(first[:2])
    down, across = optical_flow_ilk(*small, radius=FLOW_RADIUS, num_warp=WARPS)
    zoom = max(1.0, max(first.shape[1:]) / FLOW_SIDE)
    flow = torch.stack([torch.from_numpy(across), torch.from_numpy(down)]).to(first) * zoom
    return functional.interpolate(flow[None], first.shape[1:], mode="bilinear", align_corners=False)[0]
