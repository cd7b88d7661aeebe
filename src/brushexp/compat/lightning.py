"""Private parts of Lightning; tried with Lightning 2.6.6."""

from __future__ import annotations

from typing import Any

import lightning as L
from torch import Tensor


class QuickModule(L.LightningModule):
    """A LightningModule in which Lightning's notes cost little.

    Some fifty times a step Lightning notes in ``_current_fx_name`` which hook it calls, and a module would look each
    time whether that is a parameter or a part.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if name == "_current_fx_name":
            self.__dict__[name] = value
        else:
            super().__setattr__(name, value)


def trainer_of(module: L.LightningModule) -> L.Trainer | None:
    """Return the Trainer of a module; None where it has none, for which Lightning's own property raises an error."""
    return module._trainer


def publish_values(module: L.LightningModule, values: dict[str, Tensor]) -> None:
    """Show callbacks the values of a step.

    `LightningModule.log` takes half a millisecond a step, and gives values of an earlier step where it is left out.
    """
    if (trainer := trainer_of(module)) is not None:
        trainer.callback_metrics.update(values)
        trainer.logged_metrics.update(values)
