"""Keys of ``task=tubes``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from omegaconf import DictConfig

from brushexp.bounds import Rule, above, between
from brushexp.config.keys import key
from brushexp.config.rules import check_painting
from brushexp.config.schema import PaintTask
from brushexp.errors import UserError
from brushexp.pictures.load import size_of_picture
from brushexp.plugins.color.rgb import Rgb
from brushexp.plugins.metric.base import STANDARD
from brushexp.plugins.painter.base import Painter
from brushexp.registry import keep_built, plugin_of
from brushexp_tubes.paints import load_tubes

LOOK = "tubes"
BRUSH_MM = (0.5, 200.0)


@dataclass
class TubesTask(PaintTask):
    """Paint with mixtures of given tubes and with brushes of given widths; tubes=eight asks for this task."""

    module = "brushexp_tubes.task"
    groups: ClassVar[dict[str, Any]] = PaintTask.groups | {"metric": [*STANDARD, "ciede2000"]}
    presets: ClassVar[dict[str, str]] = PaintTask.presets | {"look": LOOK}

    tubes: str = key("eight", "set of tubes: eight, acrylics, primaries, zorn, or a CSV file", Rule(load_tubes))
    mixtures: int = key(24, "mixtures of up to three tubes, at most", between(1, 200))
    brushes: list[float] = key([25.0, 12.0, 6.0], "widths of the brushes in mm", between(*BRUSH_MM))
    width_cm: float = key(30.0, "width of the painting in cm", above(0, 2000))
    load: float = key(12.0, "length that a brush paints with one load, in its widths", between(1, 1000))

    @staticmethod
    def suits(typed: Mapping[str, Any]) -> bool:
        return typed.get("tubes") is not None or typed.get("look") == LOOK

    @staticmethod
    def check(cfg: DictConfig, overrides: Sequence[str]) -> None:
        size = size_of_picture(cfg.image, "image", cfg.resolution)
        if isinstance(keep_built(cfg.painter), Painter):
            name = plugin_of(cfg.painter).name
            raise UserError(f"tubes={cfg.tubes} is for painter=gradient, not {name}; drop painter, or drop tubes")
        if not cfg.brushes:
            raise UserError("brushes=[] leaves nothing to paint with; give widths in mm, 'brushes=[25,12,6]'")
        if cfg.wet:
            raise UserError(f"wet={cfg.wet:g} drags colours that no mixture has; drop wet, or drop tubes")
        if not isinstance(keep_built(cfg.color), Rgb):
            raise UserError(
                f"color={plugin_of(cfg.color).name} is for glazes, and paint of tubes= is opaque; drop color"
            )
        if (thin := min(cfg.brushes) * size[1] / (10 * cfg.width_cm)) < 1:
            cure = f"set resolution={round(max(size) / thin) + 1}, or leave that brush out"
            raise UserError(f"a brush of {min(cfg.brushes):g} mm is {thin:.2g} pixels wide; {cure}")
        check_painting(cfg, overrides, size)
