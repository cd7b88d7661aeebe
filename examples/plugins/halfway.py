"""Callback plugin in a single file: ``callbacks=halfway``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from brushexp.contracts import register
from brushexp.contracts.families import Callback
from brushexp.contracts.files import write_picture

if TYPE_CHECKING:  # Lightning takes seconds to import; --help should not
    import lightning as L


@register("callbacks", "halfway")
class Halfway(Callback):
    """Saves ``halfway.png``, the painting after half of the steps."""

    def open(self, folder: Path) -> L.Callback:
        from lightning.pytorch.callbacks import LambdaCallback  # noqa: PLC0415

        before = [0.0]

        def keep(trainer: L.Trainer, module: L.LightningModule, *_: object) -> None:
            if before[0] < 0.5 <= module.progress:
                write_picture(folder / "halfway.png", module.latest())
            before[0] = module.progress

        return LambdaCallback(on_train_batch_end=keep)
