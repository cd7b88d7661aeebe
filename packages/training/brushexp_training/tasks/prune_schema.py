"""Define the config keys of ``task=prune``."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from omegaconf import DictConfig

from brushexp.contracts import UserError, above, at_least, between, build
from brushexp.contracts.tasks import Task, key
from brushexp_training.rules import STROKES, check_batch, check_ends
from brushexp_training.schema import DATA, EMA, LIMIT, NETWORK_FIT, NetworkTrainerOptions


@dataclass
class PruneTask(Task):
    """Remove channels from a trained renderer, fine-tune the remaining network, and compare the results."""

    is_research = True
    module = "brushexp_training.tasks.prune"
    groups: ClassVar[dict[str, Any]] = {"renderer": "inverse_vgg", "blend": "tiled", "engine": "fluid"} | NETWORK_FIT
    presets: ClassVar[dict[str, str]] = {"trainer": "network"}

    ratios: list[float] = key([0, 0.25, 0.5], "shares of every layer's channels to remove; 0 = none", between(0, 0.99))
    data: list[str] | None = key(None, DATA, STROKES)
    n: int | None = key(None, "number of test strokes to measure on; null = all", at_least(1, typical=1000))
    other_data: bool = key(False, "whether to allow strokes of a brush not used in training")
    batch_size: int = key(64, "strokes per gradient step", at_least(1))
    epochs: int | None = key(
        None, "passes through the data to fine-tune each network; null = no limit", at_least(0, typical=5)
    )
    minutes: float | None = key(10, "wall time per network in minutes; null = no limit", at_least(0))
    lr: float = key(3.0e-4, "peak learning rate", above(0, 1))
    ema: float = key(0.999, EMA, between(0, 1))
    limit: int | None = key(None, LIMIT, at_least(1, typical=10000))
    trainer: NetworkTrainerOptions = field(default_factory=NetworkTrainerOptions)

    @staticmethod
    def check(cfg: DictConfig, overrides: Sequence[str]) -> None:
        from brushexp_training.renderers.pruning import check_prunable  # noqa: PLC0415
        from brushexp_training.rules import check_trainable  # noqa: PLC0415
        from brushexp_training.stroke_sets.stroke_data import check_origin  # noqa: PLC0415

        if not cfg.ratios:
            raise UserError("ratios=[] prunes nothing; try 'ratios=[0,0.25,0.5]'")
        if cfg.renderer.get("checkpoint") is None:
            raise UserError("there are no trained weights to prune; give those of task=train: renderer.checkpoint=...")
        check_ends(cfg)
        renderer = build(cfg.renderer)
        check_prunable(renderer)
        check_trainable(renderer, check_origin(cfg).window)
        check_batch(cfg, renderer.window)
