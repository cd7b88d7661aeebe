"""Change the colour of the ground at each step, so that strokes close the gaps between them."""

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
    """Paint each step on a ground of a random colour, so that the loss penalises bare ground.

    Strokes end up closer together or more opaque than on a ground that happens to match the picture. Steps that compare
    only a part of the picture keep the painting's own ground.

    Args:
        until: fraction of the steps after which the painting's own ground is restored.
    """

    until: Annotated[float, between(0, 1)] = 0.9

    def check(self, cfg: DictConfig, size: tuple[int, int]) -> None:
        check_steps(cfg, "change=random_ground")

    def aim(self, target: Tensor, ground: Tensor, state: PaintingState) -> tuple[Tensor, Tensor]:
        if not state.is_whole or state.progress >= self.until:
            return target, ground
        return target, random_color(ground, state.step)


def random_color(like: Tensor, step: int) -> Tensor:
    """Sample the colour (3,) for a step, seeded with the step's number, so that resumed runs use the same colours."""
    return torch.rand(like.shape, generator=torch.Generator().manual_seed(step), dtype=like.dtype).to(like.device)
