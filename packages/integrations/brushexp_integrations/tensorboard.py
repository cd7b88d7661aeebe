"""Log a run to TensorBoard."""

from __future__ import annotations

import io
from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np
import yaml  # type: ignore[import-untyped,unused-ignore]
from PIL import Image

from brushexp.contracts import UserError, register
from brushexp.contracts.families import Logger, Run
from brushexp.contracts.results import markdown_table

if TYPE_CHECKING:
    from lightning.pytorch.loggers import Logger as LightningLogger
    from lightning.pytorch.loggers import TensorBoardLogger


@register("logger", "tensorboard")
class TensorBoard(Logger):
    """Log curves, pictures, settings and metrics; ``tensorboard --logdir`` shows a run, or all runs of a sweep.

    The files are in each run's ``tensorboard`` folder. The command-line arguments are logged as hyperparameters
    together with the final metrics, so that a sweep is shown as a table; all settings and the catalogue's path are
    logged as text.
    """

    def __init__(self) -> None:
        if find_spec("tensorboard") is None:
            raise UserError("logger=tensorboard needs the package tensorboard; pip install 'brushexp[tensorboard]'")
        self._curves: TensorBoardLogger | None = None

    def open(self, run: Run) -> LightningLogger:
        from lightning.pytorch.loggers import TensorBoardLogger  # noqa: PLC0415

        self._curves = TensorBoardLogger(run.folder, name="", version="tensorboard", default_hp_metric=False)
        self._curves.log_hyperparams(dict(run.settings))  # into hparams.yaml; the table needs metrics
        settings = yaml.safe_dump(dict(run.settings), sort_keys=False)
        self._curves.experiment.add_text("settings", f"```\n{settings}```")
        return self._curves

    def finish(self, run: Run) -> None:
        if self._curves is None:
            return
        writer = self._curves.experiment
        for step, jpeg in run.frames.items():
            writer.add_image("frames", np.asarray(Image.open(io.BytesIO(jpeg))), step, dataformats="HWC")
        for name, path in run.pictures.items():
            writer.add_image(name, np.asarray(Image.open(path)), run.step, dataformats="HWC")
        if run.metrics:
            final = {f"final/{name}": value for name, value in run.numbers.items()}
            self._curves.log_hyperparams(dict(run.chosen), final, run.step)
        for name, values in {"metrics": run.row, "files": run.files}.items():
            if values:
                table = markdown_table({"name": [*values], "value": [*values.values()]}, escape=False)
                writer.add_text(name, table, run.step)
