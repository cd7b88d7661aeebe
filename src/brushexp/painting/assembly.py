"""From the config to what a painting is made of: its parts and its first strokes."""

import logging
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import torch
from omegaconf import DictConfig
from torch import Tensor

from brushexp.compositing.mixing import mixing
from brushexp.errors import UserError
from brushexp.painting.components import Components, Stage
from brushexp.pictures.color import recolored
from brushexp.pictures.focus import focus_map, focus_weights
from brushexp.pictures.load import check_ratio
from brushexp.plugins.density.base import Density
from brushexp.plugins.init.base import Initializer
from brushexp.plugins.loss.base import Loss
from brushexp.plugins.loss.style import Style
from brushexp.plugins.renderer.base import Renderer
from brushexp.plugins.sampler.whole import Whole
from brushexp.registry import build_named, keep_built, plugin_of, take_built
from brushexp.strokes.brushwork import load_brushwork, with_brushwork
from brushexp.strokes.catalogue import Strokes
from brushexp.strokes.storage import load_catalogue
from brushexp.system.runtime import check_memory

log = logging.getLogger(__name__)
BYTES_PER_PIXEL = 500  # that painting takes at least; blend=tiled was seen to take 800
BYTES_PER_WINDOW_PIXEL = 32  # RGBA in 32 bits, and its gradient
STYLE, BRUSHWORK = "style", "brushwork"  # names of the losses that the keys of ``style`` add
AUTO = "auto"  # warm_up that leaves it to the renderer


def components_of(cfg: DictConfig) -> Components:
    """Build what the config names."""
    others = {family: take_built(cfg[family]) for family in ("order", "density", "sampler", "optimizer")}
    blend = mixing(take_built(cfg.blend), take_built(cfg.color))
    return Components(stages=stages_of(cfg), blend=blend, losses=losses_of(cfg), **others)


def losses_of(cfg: DictConfig) -> dict[str, Loss]:
    """The chosen losses, and those that ``style.image`` and ``style.brushwork`` add to them."""
    content = 1.0 if cfg.style.image is None else cfg.style.content
    losses: dict[str, Loss] = {str(name): take_built(node) for name, node in cfg.loss.items()}
    for loss in losses.values():
        loss.weight *= content
    if cfg.style.image is not None:
        losses[STYLE] = take_built(cfg.style.loss)
    if cfg.style.brushwork is not None:
        losses[BRUSHWORK] = take_built(cfg.style.strokes)
    return losses


def check_losses(cfg: DictConfig) -> None:
    """Stop with a UserError if two losses of `losses_of` would have one name, or one nothing to compare with."""
    for key, name in (("image", STYLE), ("brushwork", BRUSHWORK)):
        if cfg.style[key] is not None and name in cfg.loss:
            raise UserError(f"style.{key}={cfg.style[key]} brings the loss {name} with it; drop {name} from loss=...")
    if BRUSHWORK in cfg.loss and cfg.loss[BRUSHWORK].catalogue is None:
        raise UserError("loss=brushwork has nothing to compare with; set loss.brushwork.catalogue=catalogue.h5")


def in_colors(target: Tensor, parts: Components) -> tuple[Tensor, Tensor]:
    """The target in the colours of the style picture, or as it is if the style takes its colours; and that picture."""
    style = parts.losses[STYLE]
    assert isinstance(style, Style)
    picture = style.picture(target)
    return (target if style.colors == "content" else recolored(target, like=picture)), picture


def focus_of(cfg: DictConfig, target: Tensor) -> tuple[Tensor | None, Tensor | None]:
    """How much each pixel (H, W) of the target counts, of mean 1, if ``focus`` is set; and what that was made from."""
    if cfg.focus is None:
        return None, None
    attended = focus_map(cfg.focus, target)
    return focus_weights(attended, cfg.focus_strength), attended


def stages_of(cfg: DictConfig, make: Callable[[DictConfig], Renderer] = take_built) -> list[Stage]:
    """The renderers and their steps: the chosen one, and before it the one that ``warm_up`` asks for, if any."""
    name, renderer = plugin_of(cfg.renderer).name, make(cfg.renderer)
    first = renderer.warm_up if cfg.warm_up == AUTO else cfg.warm_up
    if first is None or not (cfg.steps or cfg.seconds):
        return [Stage(name, renderer, cfg.steps)]
    return [Stage(first, build_named("renderer", first, {}), cfg.steps), Stage(name, renderer, cfg.finish_steps)]


def paced(parts: Components, steps_per_stroke: float | None, strokes: Strokes, size: tuple[int, int]) -> Components:
    """The same, with as many steps as partial updates of the first ``strokes`` on a canvas of ``size`` (H, W) take.

    Each stroke moves ``steps_per_stroke`` times in the first stage; None leaves its steps as they are. Those of a last
    stage, that of a slow renderer, always count for each stroke.
    """
    first, *others = parts.stages
    if steps_per_stroke is None and not others:
        return parts
    each = parts.sampler.steps_per_round(strokes, size)
    if steps_per_stroke is not None:
        first = replace(first, steps=round(steps_per_stroke * each))
    return replace(parts, stages=[first, *(replace(stage, steps=stage.steps * each) for stage in others)])


def check_size(cfg: DictConfig, strokes: int, size: tuple[int, int]) -> None:
    """Refuse (UserError) what memory cannot hold: pictures of a canvas of ``size``, and windows of its strokes."""
    pixels = math.prod(size)
    window = max(getattr(stage.renderer, "window", 0) for stage in stages_of(cfg, keep_built))
    windows = strokes * window**2 * BYTES_PER_WINDOW_PIXEL if isinstance(keep_built(cfg.sampler), Whole) else 0
    smaller = "resolution=, fewer strokes= or sampler=patches" if windows else "resolution="
    what = f"{strokes} strokes on {size[1]} x {size[0]} pixels"
    check_memory(pixels * BYTES_PER_PIXEL + windows, what, f"choose a smaller {smaller}")


def first_strokes(cfg: DictConfig, target: Tensor, density: Density, focus: Tensor | None) -> tuple[Strokes, int]:
    """The strokes to start from, and how many the painting may have in the end.

    They are those of ``catalogue``, or those that ``init`` makes (told the focus, if any), with ``style.brushwork``.
    """
    _, height, width = target.shape
    if cfg.catalogue is not None:
        if cfg.style.brushwork is not None:
            log.info("the strokes of %s stay as they are; style.brushwork only pulls at them", cfg.catalogue)
        strokes = strokes_from(Path(cfg.catalogue), (height, width))
        return strokes, budget_of(cfg, (height, width), density, len(strokes))
    n = budget_of(cfg, (height, width), density)
    generator = torch.Generator().manual_seed(cfg.seed)
    initializer: Initializer = take_built(cfg.init)
    strokes = initializer(target, density.first(n, steps_planned(cfg)), generator, focus)
    if cfg.style.brushwork is not None:
        strokes = with_brushwork(strokes, load_brushwork(Path(cfg.style.brushwork)), (height, width), generator)
    return strokes, n


def steps_planned(cfg: DictConfig) -> int:
    """The steps of a painting, or, of so many for each stroke, as many as there are at least."""
    return cfg.steps if cfg.steps_per_stroke is None else round(cfg.steps_per_stroke)


def budget_of(cfg: DictConfig, size: tuple[int, int], density: Density, there: int | None = None) -> int:
    """How many strokes a picture of ``size`` may have in the end; as many are ``there`` in ``catalogue``, if it is set.

    A UserError if the picture has no room for as many, or nothing adds those that are missing.
    """
    n = there if cfg.strokes is None else cfg.strokes
    if n is None:
        n = max(1, round(math.prod(size) / cfg.pixels_per_stroke))
        n = n if cfg.max_strokes is None else min(n, cfg.max_strokes)
    if there is not None and (n < there or (n > there and density.first(n, steps_planned(cfg)) == n)):
        raise UserError(
            f"strokes={n}, but {cfg.catalogue} has {there}; drop strokes or catalogue, or let a policy that "
            "adds strokes come to a larger number: density=adaptive, with enough steps for it"
        )
    if there is None and n > math.prod(size):
        cure = f"set strokes to {math.prod(size)} at most, or enlarge the picture with resolution"
        raise UserError(f"strokes={n} is more than the {size[0]} x {size[1]} picture has pixels; {cure}")
    return n


def strokes_from(path: Path, size: tuple[int, int]) -> Strokes:
    """Strokes of a saved catalogue, bottom first, on a canvas of ``size``."""
    saved = load_catalogue(path)
    check_ratio(str(path), saved.size, size, "catalogue")
    return saved.strokes[saved.depth.argsort()].moved(zoom=max(size) / max(saved.size))
