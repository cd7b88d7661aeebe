"""Draw strokes with your own brushes: scanned strokes, and brush files from GIMP, Photoshop, Procreate and Krita."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Annotated

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from brushexp.contracts import register
from brushexp.contracts.families import Renderer
from brushexp.contracts.layers import TexturedProfile
from brushexp.contracts.members import FADED, Textured
from brushexp.contracts.strokes import Strokes
from brushexp_media.brushes.marks import ROWS, Mark, columns_for, read_marks, texture_of
from brushexp_media.brushes.rule import BRUSH

TONE = 0.25  # share of white in the fullest hair, and of black in the barest
AROUND = 9  # texels of the neighbourhood with which coverage is compared
DRY = (256, 1400)  # rows and columns of the dry brush that is used without files


@register("renderer", "brush")
class Brush(Renderer):
    """Bezier stroke with the mark of your own brush; ``brush=stroke.png`` on the command line.

    A picture of a stroke, whether dark on white or bright on black, is converted to coverage: its alpha or, if it has
    none, its difference from the grey of its border. The picture shows a stroke painted from left to right, or from top
    to bottom. The stroke's start and end keep their shape, and its middle is repeated in longer strokes. A GIMP brush
    (.gbr, .gih) or a brush from a set (.abr, .brushset, .bundle) is a stamp, which is dragged along a line at its own
    spacing. ``brushexp brushes stroke.png`` shows the result.

    Args:
        files: pictures, .gbr, .gih, .abr, .brushset and .bundle files, or folders of these; each stroke has one of
            their marks; without files, a dry brush.
    """

    def __init__(self, *, files: Annotated[list[str] | None, BRUSH] = None) -> None:
        super().__init__()
        marks = marks_of(files)
        columns = columns_for(marks)
        self.drawn = Textured(variants=len(marks), rows=ROWS, columns=columns, checkpoint=None)
        weights = torch.stack([weights_of(texture_of(mark, columns)) for mark in marks])
        self.drawn.textures = nn.Parameter(weights, requires_grad=False)

    def forward(self, strokes: Strokes) -> TexturedProfile:
        return self.drawn.forward(strokes)


def marks_of(files: Sequence[str] | None) -> list[Mark]:
    """Read the marks from files; without files, return the dry-brush mark."""
    return read_marks(files) if files else [Mark("dry brush", dry_brush())]


def weights_of(coverage: Tensor) -> Tensor:
    """Convert coverage (rows, columns) to texture weights (3, rows, columns); denser hairs become paler and higher."""
    around = functional.avg_pool2d(coverage[None], AROUND, 1, AROUND // 2)[0]
    tone = TONE * torch.tanh(3 * (coverage - around)) * (coverage > FADED)
    height = (0.15 + 0.85 * coverage) * (coverage > FADED)
    inside = (part.clamp(FADED, 1 - FADED).logit() for part in (coverage, height))
    return torch.stack([next(inside), tone.atanh(), next(inside)])


@lru_cache(maxsize=1)
def dry_brush() -> np.ndarray:
    """Draw a deterministic dry-brush mark, whose hairs start together and run out of paint one by one."""
    rows, columns = DRY
    chance = np.random.default_rng(0)
    load, begin = np.repeat(chance.random((2, rows // 4)), 4, axis=1)
    along, across = np.linspace(0, 1, columns)[None], np.linspace(-1, 1, rows)[:, None]
    rounded = 0.06 * np.sqrt(1 - 0.97 * across**2)
    start = (60 * (along - 0.06 + rounded - 0.03 * begin[:, None])).clip(0, 1)
    finish = (30 * (1.05 - 0.45 * load[:, None] ** 2 - along)).clip(0, 1)
    return (start * finish * (0.55 + 0.45 * load[:, None])).astype(np.float32)
