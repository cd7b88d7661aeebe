"""Simplify the forms in a picture, as a painter does by leaving out detail."""

import torch
from torch import Tensor

FEWER = 40  # factor by which abstraction 1 reduces the number of strokes
FLATNESS = 0.2  # weight of total variation at abstraction 1


def flatten_picture(picture: Tensor, weight: float) -> Tensor:
    """Flatten a picture (3, H, W) but preserve its edges, by total variation denoising (Rudin, Osher, Fatemi, 1992)."""
    from skimage.restoration import denoise_tv_chambolle  # noqa: PLC0415  (slow to import)

    if not weight:
        return picture
    flat = denoise_tv_chambolle(picture.double().cpu().numpy(), weight=weight, channel_axis=0, max_num_iter=100)
    return torch.from_numpy(flat).to(picture).clamp(0, 1)


def simplify(picture: Tensor, abstraction: float, attended: Tensor | None) -> Tensor:
    """Flatten a picture (3, H, W) by ``abstraction`` in [0, 1], except where ``attended`` (H, W) in [0, 1] is high."""
    if not abstraction:
        return picture
    flat = flatten_picture(picture, FLATNESS * abstraction)
    return flat if attended is None else torch.lerp(flat, picture, attended)
