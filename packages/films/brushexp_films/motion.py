"""The motion between two pictures of a film is estimated."""

import torch
from torch import Tensor
from torch.nn import functional

from brushexp.pictures.load import downsampled

SIDE = 128  # pixels of the longer side at which motion is sought: strokes need no more, and it takes a few hundredths
RADIUS = 5  # of the windows there, pixels
WARPS = 3  # refinements of each level of the pyramid


def motion(first: Tensor, second: Tensor) -> Tensor:
    """Estimate where each pixel of the ``first`` picture goes, (2, H, W): x to the right and y down, in pixels.

    By the iterative Lucas-Kanade method of scikit-image (Le Besnerais and Champagnat, 2005) on the brightness of
    small copies of the pictures (3, H, W).
    """
    from skimage.registration import optical_flow_ilk  # noqa: PLC0415  (slow to import)

    small = [downsampled(picture, SIDE).mean(0).cpu().numpy() for picture in (first, second)]
    if min(small[0].shape) < 2 * RADIUS:
        return torch.zeros_like(first[:2])
    down, across = optical_flow_ilk(*small, radius=RADIUS, num_warp=WARPS)
    zoom = max(1.0, max(first.shape[1:]) / SIDE)
    flow = torch.stack([torch.from_numpy(across), torch.from_numpy(down)]).to(first) * zoom
    return functional.interpolate(flow[None], first.shape[1:], mode="bilinear", align_corners=False)[0]
