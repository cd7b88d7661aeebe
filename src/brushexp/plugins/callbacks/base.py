"""Base class for callbacks, which act while a picture is painted or a network is trained."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # Lightning takes seconds to import; --help should not
    import lightning as L


class Callback(ABC):
    """Creates a Lightning callback that acts while a picture is painted or a network is trained.

    The callback may use any hook described at https://lightning.ai/docs/pytorch/stable/extensions/callbacks.html. The
    Lightning module has ``progress`` (0 to 1), ``state_line()`` and ``global_step``; the module of a painting also has
    ``latest()``, which returns the current picture.

    >>> class Steps(Callback):
    ...     def open(self, folder):
    ...         from lightning.pytorch.callbacks import LambdaCallback
    ...         return LambdaCallback(on_train_end=lambda trainer, module: print(trainer.global_step))
    """

    @abstractmethod
    def open(self, folder: Path) -> L.Callback:
        """Create the callback for a run; it may write only to the run's folder."""
