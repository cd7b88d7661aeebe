"""What is watched while a renderer is trained: pictures of held-out strokes, and their FID."""

from pathlib import Path
from typing import Any

import lightning as L
import torch
from torch import Tensor

from brushexp.system.files import write_picture
from brushexp.training.evaluation import effl0_distance, stroke_sheet

SHOWN_PAIRS, PAIR_COLUMNS = 24, 6  # held-out strokes on a sheet, and in a row of it


class HeldOutSheet(L.Callback):
    """After every validation ``pictures/epoch_XXX.png``: held-out strokes as drawn on the left, the truth on the right.

    The latest sheet is also ``validation.png`` in the run's folder.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def on_validation_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        self.pairs: list[Tensor] = []

    def on_validation_batch_end(self, trainer: L.Trainer, pl_module: Any, outputs: Any, batch: Any, *_: object) -> None:
        if sum(map(len, self.pairs)) < SHOWN_PAIRS:
            self.pairs.append(torch.cat([outputs, batch.images], dim=3).cpu())

    def on_validation_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        picture = stroke_sheet(torch.cat(self.pairs)[:SHOWN_PAIRS], PAIR_COLUMNS)
        (self.folder / "pictures").mkdir(exist_ok=True)
        write_picture(self.folder / "pictures" / f"epoch_{trainer.current_epoch:03d}.png", picture)
        write_picture(self.folder / "validation.png", picture)


class FrechetDistance(L.Callback):
    """Logs ``validation/fid_effl0`` of the first ``n`` held-out strokes at every validation, see `FeatureDistance`."""

    def __init__(self, n: int) -> None:
        self.n = n

    def on_validation_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        self.left, self.distance = self.n, effl0_distance(pl_module.device)

    def on_validation_batch_end(self, trainer: L.Trainer, pl_module: Any, outputs: Any, batch: Any, *_: object) -> None:
        if self.left > 0:
            self.distance.add(outputs[: self.left].clamp(0, 1), batch.images[: self.left])
            self.left -= len(outputs)

    def on_validation_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        pl_module.log("validation/fid_effl0", self.distance.figures()["fid_effl0"])
