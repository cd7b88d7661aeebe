"""Move the target of dry strokes by what the wet painting lacks."""

from typing import Any

import lightning as L
import torch

from brushexp.contracts import UserError
from brushexp.contracts.painting import drag_paint
from brushexp.contracts.runs import RunRecord


class WetTarget(L.Callback):
    """Set the target of a painter's steps to target + dry - wet, every so many steps; see `WetSteps`."""

    def __init__(self, every: int, after: float, wet: float | None) -> None:
        self.every, self.after, self.wet = every, after, wet
        self.lack: torch.Tensor | None = None  # (3, H, W) dry - wet, when it was last seen

    def setup(self, trainer: L.Trainer, painter: Any, stage: str) -> None:
        if not hasattr(painter, "catalogue"):
            raise UserError("callbacks=wet_steps is for painter=gradient; drop it, or drop painter=")
        if self.wet is None:
            records = [one.record for one in trainer.callbacks if isinstance(one, RunRecord)]  # type: ignore[attr-defined]
            self.wet = float(records[0]["settings"]["wet"]) if records else 0.0
        if not self.wet:
            raise UserError("callbacks=wet_steps is for wet paint; add wet=0.5, or drop it")

    def on_train_start(self, trainer: L.Trainer, painter: Any) -> None:
        self._aim(painter, self.lack)

    def on_train_batch_end(self, trainer: L.Trainer, painter: Any, *_: object) -> None:
        step, steps = painter.schedule.step, painter.schedule.steps
        if not painter.is_coarse and step % self.every == 0 and self.after * steps <= step < steps:
            self._look(painter)

    @torch.no_grad()
    def _look(self, painter: Any) -> None:
        assert self.wet is not None
        wet = painter.picture.draw(*drag_paint(painter, self.wet))
        self.lack = painter.draw_whole() - wet
        self._aim(painter, self.lack)

    def _aim(self, painter: Any, lack: torch.Tensor | None) -> None:
        """Give the steps their target, and let them forget the earlier one."""
        target = painter.pictures["target"].to(painter.picture.target)
        if lack is not None:
            target = (target + lack.to(target)).clamp(0, 1)
        painter.picture.target = target
        painter.picture.forget()

    def on_train_end(self, trainer: L.Trainer, painter: Any) -> None:
        self._aim(painter, None)

    def on_exception(self, trainer: L.Trainer, painter: Any, exception: BaseException) -> None:
        self._aim(painter, None)

    def state_dict(self) -> dict[str, Any]:
        return {"lack": self.lack}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        self.lack = state_dict["lack"]
