"""Paint on a ground of another colour at each step, so that the strokes close the cracks between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import torch

from brushexp.contracts import UserError, between, register
from brushexp.contracts.families import Callback
from brushexp.contracts.members import Whole

if TYPE_CHECKING:
    from pathlib import Path

    import lightning as L


@register("callbacks", "random_ground")
@dataclass(kw_only=True)
class RandomGround(Callback):
    """Paint each step on a ground of a random colour: where it shows, the loss sees it.

    Strokes then lie closer, or more opaque, than on a ground that happens to have the colour of the picture. Steps that
    look at a part of the picture keep the ground.

    Args:
        until: share of the steps after which the ground is its own again.
    """

    until: Annotated[float, between(0, 1)] = 0.9

    def open(self, folder: Path) -> L.Callback:
        from lightning.pytorch.callbacks import LambdaCallback  # noqa: PLC0415  (takes seconds to import)

        own: list[Any] = []  # the ground, while another is in its place

        def check(_: L.Trainer, painter: Any, stage: str) -> None:
            if not hasattr(painter, "catalogue"):
                raise UserError("callbacks=random_ground is for painter=gradient; drop it, or drop painter=")

        def change(_: L.Trainer, painter: Any, *__: object) -> None:
            is_whole = painter.is_coarse or isinstance(painter.components.sampler, Whole)
            if is_whole and painter.progress < self.until:
                own.append(painter.picture.background)
                painter.picture.background = random_color(own[0], painter.schedule.step)

        def restore(_: L.Trainer, painter: Any, *__: object) -> None:
            if own:
                painter.picture.background = own.pop()

        return LambdaCallback(
            setup=check, on_train_batch_start=change, on_train_batch_end=restore, on_exception=restore
        )


def random_color(like: torch.Tensor, step: int) -> torch.Tensor:
    """Draw the colour (3,) of a step, which a resumed run draws again."""
    return torch.rand(like.shape, generator=torch.Generator().manual_seed(step), dtype=like.dtype).to(like.device)
