"""Choose the size at which strokes are optimised: for large photographs, no larger than the stroke count requires."""

import logging
import math
from dataclasses import dataclass
from pathlib import Path

from omegaconf import DictConfig

from brushexp.errors import UserError
from brushexp.painting.components import stroke_budget
from brushexp.pictures.limits import MAX_PIXELS
from brushexp.pictures.load import shrink_to, sides_of_picture, size_at, size_of_picture
from brushexp.plugins.painter.base import Painter
from brushexp.registry import keep_built, plugin_of
from brushexp.strokes.storage import load_catalogue

AUTO = "auto"  # value of working_resolution: choose by the number of strokes
PIXELS_PER_STROKE = 80  # minimum pixels of the working picture per stroke, from `benchmarks/photographs.py --pixels`
SMALLEST_SIDE = 1024  # pixels on the longer side below which pictures are optimised at full size
SMALLEST_SHORT_SIDE = 256  # minimum pixels on the other side, so that a panorama keeps its rows
WORTH_IT = 1.5  # least ratio of sides for which shrinking saves enough time
LARGEST_PAINTING = 50_000_000  # maximum number of pixels of a painting

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Sizes:
    """Height and width, in pixels, of a painting and of the working picture on which its strokes are optimised."""

    painting: tuple[int, int]
    working: tuple[int, int]

    @property
    def zoom(self) -> float:
        """Pixels of the painting per pixel of the working picture."""
        return max(self.painting) / max(self.working)


def sizes_of(cfg: DictConfig) -> Sizes:
    """Choose the sizes of a painting and its working picture; raise a UserError if they are too small for the strokes.

    The two sizes are equal if ``resolution`` is set and ``working_resolution`` is not, if ``working_resolution`` is
    null, or if the painter is not gradient descent, because other painters measure their brushes in pixels.
    """
    typed, is_other = cfg.working_resolution, isinstance(keep_built(cfg.painter), Painter)
    if typed not in (None, AUTO) and is_other:
        wrong = f"working_resolution={typed} is for painter=gradient, not {plugin_of(cfg.painter).name}"
        raise UserError(f"{wrong}; type resolution={typed}, or drop it")
    if typed is None or is_other or (typed == AUTO and cfg.resolution is not None):
        size = size_of_picture(cfg.image, "image", cfg.resolution)
        return Sizes(size, size)
    painting = size_at(cfg.resolution, *shrink_to(LARGEST_PAINTING, sides_of_picture(cfg.image, "image")))
    count = None if cfg.catalogue is None else len(load_catalogue(Path(cfg.catalogue), "catalogue").strokes)
    strokes = stroke_budget(cfg, painting, keep_built(cfg.density), count)
    if typed == AUTO:
        return Sizes(painting, size_at(working_side_for(strokes, painting), *painting))
    working = size_at(min(int(typed), max(painting)), *painting)
    if math.prod(working) < strokes:
        wrong = f"working_resolution={typed} makes {working[1]} x {working[0]} pixels, fewer than the {strokes} strokes"
        raise UserError(f"{wrong}; set working_resolution=auto")
    return Sizes(painting, working)


def log_sizes(cfg: DictConfig) -> None:
    """Log a message if strokes are optimised on a smaller picture or if the painting is smaller than its source."""
    sizes, own = sizes_of(cfg), size_at(cfg.resolution, *sides_of_picture(cfg.image, "image"))
    (height, width), (rows, columns) = sizes.painting, sizes.working
    if sizes.painting != sizes.working:
        at = f"strokes are optimised at {columns} x {rows} pixels and painted at {width} x {height}"
        log.info("%s%s", at, "; to use every pixel: working_resolution=null" if math.prod(own) <= MAX_PIXELS else "")
    if max(own) > max(sizes.painting):
        more = f"brushexp export FOLDER resolution={max(own)}"
        log.info("the painting has %d x %d pixels, the picture %d x %d; larger: %s", width, height, *own[::-1], more)


def resolution_of(cfg: DictConfig) -> int | None:
    """Return the longer side, in pixels, at which a painting's source picture is loaded; None for its full size."""
    working = sizes_of(cfg).working
    is_whole = working == size_at(cfg.resolution, *sides_of_picture(cfg.image, "image"))
    return cfg.resolution if is_whole else max(working)


def working_side_for(strokes: int, painting: tuple[int, int]) -> int:
    """Compute the longer side of the picture on which strokes are optimised, given the size (H, W) of the ``painting``.

    >>> working_side_for(8000, (3000, 4000)), working_side_for(40000, (3000, 4000))
    (1024, 2066)
    >>> working_side_for(8000, (1080, 1440))
    1440
    >>> working_side_for(500, (300, 20000)), working_side_for(500, (3000, 20000))
    (20000, 1707)
    """
    longest, shortest = max(painting), min(painting)
    needed = math.ceil(longest * math.sqrt(PIXELS_PER_STROKE * strokes / math.prod(painting)))
    for_rows = math.ceil(longest * SMALLEST_SHORT_SIDE / shortest)
    side = max(SMALLEST_SIDE, needed, for_rows)
    return longest if side * WORTH_IT > longest else side
