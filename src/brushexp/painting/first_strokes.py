"""The strokes that a painting starts from, and how many it may have in the end."""

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
    """The strokes to start from, and how many the painting may have in the end.

    They are those of ``catalogue``, or those that ``init`` makes (told the focus, if any), with ``style.brushwork``.
    """
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
    """The steps of a painting, or, of so many for each stroke, as many as there are at least."""
    return cfg.steps if cfg.steps_per_stroke is None else round(cfg.steps_per_stroke)


def stroke_budget(cfg: DictConfig, size: tuple[int, int], density: Density, there: int | None = None) -> int:
    """How many strokes a picture of ``size`` may have in the end; as many are ``there`` in ``catalogue``, if it is set.

    A UserError if the picture has no room for as many, or nothing adds those that are missing.
    """
    n = there if cfg.strokes is None else cfg.strokes
    if n is None:
        n = max(1, round(math.prod(size) / cfg.pixels_per_stroke))
        n = n if cfg.max_strokes is None else min(n, cfg.max_strokes)
    if there is not None and (n < there or (n > there and density.first(n, planned_steps(cfg)) == n)):
        raise UserError(
            f"strokes={n}, but {cfg.catalogue} has {there}; drop strokes or catalogue, or let a policy that "
            "adds strokes come to a larger number: density=adaptive, with enough steps for it"
        )
    if there is None and n > math.prod(size):
        cure = f"set strokes to {math.prod(size)} at most, or enlarge the picture with resolution"
        raise UserError(f"strokes={n} is more than the {size[0]} x {size[1]} picture has pixels; {cure}")
    return n


def load_strokes(path: Path, size: tuple[int, int]) -> Strokes:
    """Strokes of a saved catalogue, bottom first, on a canvas of ``size``."""
    saved = load_catalogue(path)
    check_ratio(str(path), saved.size, size, "catalogue")
    return saved.strokes[saved.depth.argsort()].moved(zoom=max(size) / max(saved.size))
