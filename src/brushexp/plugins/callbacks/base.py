"""The contract of callbacks."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # Lightning takes seconds to import; --help should not
    import lightning as L


class Callback(ABC):
    """A callback of Lightning, beside the steps of a painting or of the training of a network.

    It may use every hook of https://lightning.ai/docs/pytorch/stable/extensions/callbacks.html. The module has
    ``progress`` (0 to 1), ``state_line()`` and ``global_step``; that of a painting also has ``latest()``, the picture.

    >>> class Steps(Callback):
    ...     def open(self, folder):
    ...         from lightning.pytorch.callbacks import LambdaCallback
    ...         return LambdaCallback(on_train_end=lambda trainer, module: print(trainer.global_step))
    """

    @abstractmethod
    def open(self, folder: Path) -> L.Callback:
        """Make the callback of a run, which writes into the run's folder only."""
