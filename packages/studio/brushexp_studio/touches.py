"""Repaint an area of a finished painting with finer, larger or new strokes."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from brushexp.contracts import UserError, build
from brushexp.contracts.pictures import load_mask
from brushexp.contracts.strokes import Strokes, curve_of, half_width_of, length_of, point_at, save_catalogue

TOUCH_KINDS = {"finer": "Finer here", "looser": "Looser here", "again": "Again"}
FACTORS = {"finer": 3.0, "looser": 0.25, "again": 1.0}  # number of fresh strokes per removed stroke
FEWEST_STROKES = 6  # minimum number of strokes for a place
TOO_SMALL = "this place is too small for its strokes; paint over more of it"


@dataclass(frozen=True)
class Touch:
    """A request to repaint the area of a painting in which a ``mask`` is bright."""

    number: int  # number of the painting
    mask: Path
    how: str  # a key of `TOUCH_KINDS`


def lay_fresh_strokes(painting: Any, touch: Touch, seed: int, path: Path) -> None:
    """Replace the strokes in an area of a painting with new strokes in the same look, and write a catalogue.

    A stroke belongs to the area if both end points and the midpoint of its curve are inside the mask. ``touch.how``
    determines the number of new strokes. They are placed above all other strokes, smaller ones over larger ones, and
    are not optimised here. Raises UserError if the area is too small.
    """
    saved = painting.finished.job.saved
    mask = load_mask(str(touch.mask), saved.size, "region") >= 0.5
    goes = lies_in(mask, saved.strokes)
    rows, columns = (mask.any(axis).nonzero()[:, 0] for axis in (1, 0))
    if not len(rows):
        raise UserError("first paint over the place to repaint")
    top, bottom, left, right = int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1
    target = picture_at(painting.target, saved.size)[:, top:bottom, left:right].contiguous()
    share = float(mask[top:bottom, left:right].double().mean())
    count = max(FEWEST_STROKES, FACTORS[touch.how] * int(goes.sum())) / share
    initializer, generator = build(painting.settings.cfg.init), torch.Generator().manual_seed(seed)
    fresh = initializer(target, min(round(count), target[0].numel()), generator).moved(shift=(left, top))
    fresh = fresh[lies_in(mask, fresh)]
    if len(fresh) < FEWEST_STROKES:
        raise UserError(TOO_SMALL)
    fresh = fresh[(half_width_of(fresh) * length_of(curve_of(fresh))).argsort(descending=True)]
    stays = saved.depth.argsort().flip(0)  # top to bottom
    stays = stays[~goes[stays]]
    numbers = torch.empty(len(goes), dtype=torch.long)
    numbers[~goes] = torch.arange(len(stays))
    front_to_back = torch.cat([torch.arange(len(fresh)).flip(0) + len(stays), numbers[stays]])
    strokes = Strokes.join(saved.strokes[~goes], fresh.map(lambda value: value.to(saved.strokes.position.dtype)))
    save_catalogue(path, saved.with_strokes(strokes, front_to_back, saved.background))


def lies_in(mask: Tensor, strokes: Strokes) -> Tensor:
    """Check whether both end points and the midpoint of each of N strokes' curves are inside a mask (H, W)."""
    points = point_at(curve_of(strokes)[:, None], torch.linspace(0, 1, 3)).floor().long()  # (N, 3, 2)
    x, y = points[..., 0].clamp(0, mask.shape[1] - 1), points[..., 1].clamp(0, mask.shape[0] - 1)
    inside: Tensor = mask[y, x].all(1)
    return inside


def picture_at(pixels: np.ndarray, size: tuple[int, int]) -> Tensor:
    """Resize a picture (h, w, 3), uint8, to ``size`` (H, W); return it as (3, H, W) in [0, 1]."""
    scaled = Image.fromarray(pixels).resize((size[1], size[0]), Image.Resampling.LANCZOS)
    return torch.from_numpy(np.asarray(scaled, np.float32) / 255).movedim(2, 0)


def overrides_of(keys: dict[str, Any], touch: Touch, catalogue: Path) -> dict[str, Any]:
    """Convert a painting's overrides to overrides that repaint one area.

    The new painting starts from the strokes in ``catalogue``.
    """
    kept = {key: value for key, value in keys.items() if key != "strokes" and key.partition(".")[0] != "init"}
    return kept | {"catalogue": str(catalogue), "region": str(touch.mask)}
