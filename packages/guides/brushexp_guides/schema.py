"""Keys of ``task=guided``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from omegaconf import DictConfig

from brushexp.config.keys import key
from brushexp.config.rules import check_painting
from brushexp.config.schema import PaintTask
from brushexp.errors import UserError
from brushexp.pictures.load import PICTURE, check_ratio, sides_of_picture, size_of_picture
from brushexp.plugins.painter.base import Painter
from brushexp.registry import keep_built, plugin_of
from brushexp_guides.lines import load_lines


@dataclass
class GuidedTask(PaintTask):
    """Paint with strokes that follow lines drawn by hand where there are some; guides=lines.png asks for this task."""

    module = "brushexp_guides.task"

    guides: str | None = key(None, "lines, of any colour on white or nothing, that strokes near them follow", PICTURE)

    @staticmethod
    def suits(typed: Mapping[str, Any]) -> bool:
        return typed.get("guides") is not None

    @staticmethod
    def check(cfg: DictConfig, overrides: Sequence[str]) -> None:
        if cfg.guides is None:
            raise UserError("guides= is missing; add guides=lines.png, a picture of lines that strokes are to follow")
        if cfg.catalogue is not None:
            raise UserError(f"guides={cfg.guides} turns first strokes, and {cfg.catalogue} has its own; drop catalogue")
        if isinstance(keep_built(cfg.painter), Painter):
            name = plugin_of(cfg.painter).name
            raise UserError(f"guides={cfg.guides} is for painter=gradient, not {name}; drop painter, or drop guides")
        size = size_of_picture(cfg.image, "image", cfg.resolution)
        check_ratio(cfg.guides, sides_of_picture(cfg.guides, "guides"), size, "guides")
        load_lines(cfg.guides, size)
        check_painting(cfg, overrides, size)
