"""Compute the losses that compare the network's maps with the ground truth of paintings."""

import torch
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits as logistic_loss

from brushexp_recovery.model.channels import (
    AFFINITY,
    AFFINITY_OFFSETS,
    ATTRIBUTES,
    CENTRE,
    DIRECTION,
    LOG_SIZE,
    OCCLUSION,
    OCCLUSION_OFFSETS,
    PAINT,
    StrokeAttribute,
)
from brushexp_recovery.raster.offsets import pair_slices

APART_WEIGHTS = (4.0,) * 2 + (1.5,) * 4 + (1.0,) * 8  # weights of pairs of different strokes, by offset


def losses_of(maps: Tensor, labels: Tensor, attributes: Tensor) -> dict[str, Tensor]:
    """Compute losses of maps (B, `CHANNELS`, H, W), given labels (B, H, W) and attributes (B, attributes, H, W)."""
    paint = (labels >= 0).to(maps)
    area = paint.sum().clamp_min(1)
    own = maps[:, ATTRIBUTES]
    centre = (own[:, CENTRE] - attributes[:, CENTRE]).abs().sum(1)
    turn = (own[:, DIRECTION] - attributes[:, DIRECTION]).square().sum(1)
    size = (own[:, LOG_SIZE] - attributes[:, LOG_SIZE]).abs().sum(1)
    visible = StrokeAttribute.VISIBLE
    share = logistic_loss(own[:, visible], attributes[:, visible], reduction="none")
    return {
        "affinity": affinity_loss(maps[:, AFFINITY], labels),
        "order": occlusion_loss(maps[:, OCCLUSION], labels),
        "ground": logistic_loss(maps[:, PAINT], paint),
        "centre": (centre * paint).sum() / area,
        "turn": (turn * paint).sum() / area,
        "size": (size * paint).sum() / area,
        "share": (share * paint).sum() / area,
    }


def affinity_loss(affinity: Tensor, labels: Tensor) -> Tensor:
    """Compute the weighted logistic loss for predicting which pixel pairs are in one stroke, averaged over offsets."""
    losses = []
    for channel, (offset, weight) in enumerate(zip(AFFINITY_OFFSETS, APART_WEIGHTS, strict=True)):
        here, there, logit = pairs_at(labels, affinity[:, channel], offset)
        same = (here == there).to(logit)
        weights = torch.where(same > 0, 1.0, weight)
        losses.append((logistic_loss(logit, same, reduction="none") * weights).sum() / weights.sum().clamp_min(1))
    return torch.stack(losses).mean()


def occlusion_loss(occlusion: Tensor, labels: Tensor) -> Tensor:
    """Compute the logistic loss for predicting which stroke is on top, over pairs of pixels in different strokes."""
    total, count = occlusion.new_zeros(()), 0
    for channel, offset in enumerate(OCCLUSION_OFFSETS):
        here, there, logit = pairs_at(labels, occlusion[:, channel], offset)
        differ = here != there
        total = total + (logistic_loss(logit, (there > here).to(logit), reduction="none") * differ).sum()
        count += int(differ.sum())
    return total / max(count, 1)


def pairs_at(labels: Tensor, logits: Tensor, offset: tuple[int, int]) -> tuple[Tensor, Tensor, Tensor]:
    """Return the labels of both pixels, and the logit of the first, for each pair of pixels separated by ``offset``."""
    here, there = pair_slices(labels.shape[1:], offset)
    return labels[:, *here], labels[:, *there], logits[:, *here]
