"""Make the strokes that a painting starts from, and count those that it may have in the end."""

import logging
import math
from pathlib import Path

import torch
from omegaconf import DictConfig
from torch import Tensor

from brushexp.errors import UserError
from brushexp.pictures.load import check_ratio
from brushexp.plugins.density.base import Density
from brushexp.plugins.init.base import Initializer
from brushexp.registry import take_built
from brushexp.strokes.brushwork import load_brushwork, with_brushwork
from brushexp.strokes.catalogue import Strokes
from brushexp.strokes.storage import load_catalogue

log = logging.getLogger(__name__)


def first_strokes(cfg: DictConfig, target: Tensor, density: Density, focus: Tensor | None) -> tuple[Strokes, int]:
    """Take the strokes of ``catalogue``, or make them by ``init`` and ``style.brushwork``; return also their budget."""
    _, height, width = target.shape
    if cfg.catalogue is not None:
        if cfg.style.brushwork is not None:
            log.info("the strokes of %s stay as they are; style.brushwork only pulls at them", cfg.catalogue)
        strokes = load_strokes(Path(cfg.catalogue), (height, width))
        return strokes, stroke_budget(cfg, (height, width), density, len(strokes))
    n = stroke_budget(cfg, (height, width), density)
    generator = torch.Generator().manual_seed(cfg.seed)
    initializer: Initializer = take_built(cfg.init)
    strokes = initializer(target, density.first(n, planned_steps(cfg)), generator, focus)
    if cfg.style.brushwork is not None:
        strokes = with_brushwork(strokes, load_brushwork(Path(cfg.style.brushwork)), (height, width), generator)
    return strokes, n


def planned_steps(cfg: DictConfig) -> int:
    """Return the least number of steps of a painting."""
    return cfg.steps if cfg.steps_per_stroke is None else round(cfg.steps_per_stroke)


def stroke_budget(cfg: DictConfig, size: tuple[int, int], density: Density, count: int | None = None) -> int:
    """Return how many strokes a picture of ``size`` (H, W) may have in the end, of which ``catalogue`` has ``count``.

    A UserError if the picture is too small for them, or nothing adds the missing ones.
    """
    n = count if cfg.strokes is None else cfg.strokes
    if n is None:
        n = max(1, round(math.prod(size) / cfg.pixels_per_stroke))
        n = n if cfg.max_strokes is None else min(n, cfg.max_strokes)
    if count is not None and (n < count or (n > count and density.first(n, planned_steps(cfg)) == n)):
        raise UserError(
            f"strokes={n}, but {cfg.catalogue} has {count}; drop strokes or catalogue, or let a policy that "
            "adds strokes come to a larger number: density=adaptive, with enough steps for it"
        )
    if count is None and n > math.prod(size):
        cure = f"set strokes to {math.prod(size)} at most, or enlarge the picture with resolution"
        raise UserError(f"strokes={n} is more than the {size[0]} x {size[1]} picture has pixels; {cure}")
    return n


def load_strokes(path: Path, size: tuple[int, int]) -> Strokes:
    """Load the strokes of a catalogue, bottom first, scaled to a canvas of ``size`` (H, W)."""
    saved = load_catalogue(path)
    check_ratio(str(path), saved.size, size, "catalogue")
    return saved.strokes[saved.depth.argsort()].moved(zoom=max(size) / max(saved.size))
