"""Private parts of Lightning; tried with Lightning 2.6.6."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import lightning as L
    from torch import Tensor


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
