"""Paint on a ground of another colour at each step, so that the strokes close the cracks between them."""

from dataclasses import dataclass
from typing import Annotated

import torch
from omegaconf import DictConfig
from torch import Tensor

from brushexp.contracts import between, register
from brushexp.contracts.families import Change, PaintingState
from brushexp_changes.steps import check_steps


@register("change", "random_ground")
@dataclass(kw_only=True)
class RandomGround(Change):
    """Paint each step on a ground of a random colour: where it shows, the loss sees it.

    Strokes then lie closer, or more opaque, than on a ground that happens to have the colour of the picture. Steps that
    look at a part of the picture keep the ground.

    Args:
        until: share of the steps after which the ground is its own again.
    """

    until: Annotated[float, between(0, 1)] = 0.9

    def check(self, cfg: DictConfig, size: tuple[int, int]) -> None:
        check_steps(cfg, "change=random_ground")

    def aim(self, target: Tensor, ground: Tensor, state: PaintingState) -> tuple[Tensor, Tensor]:
        if not state.is_whole or state.progress >= self.until:
            return target, ground
        return target, random_color(ground, state.step)


def random_color(like: Tensor, step: int) -> Tensor:
    """Draw the colour (3,) of a step, which a resumed run draws again."""
    return torch.rand(like.shape, generator=torch.Generator().manual_seed(step), dtype=like.dtype).to(like.device)
