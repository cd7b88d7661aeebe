"""Simplify the forms of a picture, as a painter does who leaves out detail."""

import torch
from torch import Tensor

FEWER = 40  # factor by which abstraction 1 reduces the number of strokes
FLATNESS = 0.2  # weight of total variation at abstraction 1


def flattened(picture: Tensor, weight: float) -> Tensor:
    """Flatten the forms of a picture (3, H, W) but preserve edges, by total variation (Rudin, Osher, Fatemi, 1992)."""
    from skimage.restoration import denoise_tv_chambolle  # noqa: PLC0415  (slow to import)

    if not weight:
        return picture
    flat = denoise_tv_chambolle(picture.double().cpu().numpy(), weight=weight, channel_axis=0, max_num_iter=100)
    return torch.from_numpy(flat).to(picture).clamp(0, 1)


def simplify(picture: Tensor, abstraction: float, attended: Tensor | None) -> Tensor:
    """Flatten a picture (3, H, W) by ``abstraction``, 0 to 1, except where ``attended`` (H, W), 0 to 1, is high."""
    if not abstraction:
        return picture
    flat = flattened(picture, FLATNESS * abstraction)
    return flat if attended is None else torch.lerp(flat, picture, attended)
