"""Align the initial strokes with hand-drawn lines."""

from dataclasses import dataclass
from typing import Annotated

from omegaconf import DictConfig

from brushexp.contracts import UserError, register
from brushexp.contracts.families import Change, PaintingState
from brushexp.contracts.pictures import check_ratio, sides_of_picture
from brushexp.contracts.strokes import Strokes
from brushexp.contracts.tasks import PICTURE
from brushexp_changes.guides.lines import follow, load_lines
from brushexp_changes.steps import check_steps


@register("change", "guides")
@dataclass(kw_only=True)
class Guides(Change):
    """Align the initial strokes with nearby hand-drawn lines (for example ``guides=lines.png``).

    The strokes keep their centres, lengths, widths and colours. Optimisation starts from the aligned strokes.

    Args:
        lines: picture of the lines to follow, in any colour on a white or transparent ground, with the painting's
            aspect ratio.
    """

    lines: Annotated[str, PICTURE] | None = None

    def check(self, cfg: DictConfig, size: tuple[int, int]) -> None:
        if self.lines is None:
            raise UserError("change=guides has no lines; type guides=lines.png, a picture of lines to follow")
        check_steps(cfg, f"guides={self.lines}")
        check_ratio(self.lines, sides_of_picture(self.lines, "guides"), size, "guides")
        load_lines(self.lines, size)

    def begin(self, strokes: Strokes, state: PaintingState) -> Strokes:
        return strokes if self.lines is None else follow(strokes, load_lines(self.lines, state.size))
