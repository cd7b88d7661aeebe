"""Logger plugin in a single file: ``'logger=[csv,diary]'``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from brushexp.contracts import register
from brushexp.contracts.families import Logger, Run

if TYPE_CHECKING:  # Lightning takes seconds to import
    from lightning.pytorch.loggers import Logger as LightningLogger


@register("logger", "diary")
class Diary(Logger):
    """Writes a sentence with the outcome and the metrics of a run to ``diary/diary.txt``."""

    def open(self, run: Run) -> LightningLogger:
        from lightning.pytorch.loggers import CSVLogger  # noqa: PLC0415

        return CSVLogger(run.folder, name="diary", version="")

    def finish(self, run: Run) -> None:
        (run.folder / "diary").mkdir(exist_ok=True)
        numbers = ", ".join(f"{name} {value:.4g}" for name, value in run.numbers.items())
        (run.folder / "diary" / "diary.txt").write_text(f"The run has {run.status}: {numbers}.\n", encoding="utf-8")
