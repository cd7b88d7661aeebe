"""Keys of ``task=repaint``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from omegaconf import DictConfig

from brushexp.config.keys import key
from brushexp.config.schema import PaintTask
from brushexp.pictures.load import PICTURE


@dataclass
class RepaintTask(PaintTask):
    """Repaint one region of a painting, all else stays to the bit; region=mask.png asks for this task."""

    module = "brushexp_repaint.task"

    region: str | None = key(None, "a mask, bright = what is repainted of catalogue=", PICTURE)

    @staticmethod
    def suits(typed: Mapping[str, Any]) -> bool:
        return typed.get("region") is not None

    @staticmethod
    def check(cfg: DictConfig, overrides: Sequence[str]) -> None:
        from brushexp_repaint.as_painted import check_repainting  # noqa: PLC0415  (slow to import)

        check_repainting(cfg, overrides)
