"""Build the components of a painting: a member of every family that gradient steps need, and the initial strokes."""

import logging
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from omegaconf import DictConfig
from torch import Tensor

from brushexp.errors import UserError
from brushexp.painting.faces import TYPED_SHARE, Feature, draw_features, face_strokes
from brushexp.pictures.face import Face
from brushexp.pictures.load import check_ratio
from brushexp.plugins.blend.base import Blend, Compositor
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.color.base import ColorSpace
from brushexp.plugins.color.rgb import Rgb
from brushexp.plugins.density.base import Density
from brushexp.plugins.density.fixed import Fixed
from brushexp.plugins.init.base import Initializer
from brushexp.plugins.loss.base import BrushworkLoss, Loss
from brushexp.plugins.loss.mse import MeanSquaredError
from brushexp.plugins.optimizer.base import Optimizer
from brushexp.plugins.optimizer.torch import TorchOptim
from brushexp.plugins.order.area import Area
from brushexp.plugins.order.base import Order
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.base import PatchRenderer, Renderer
from brushexp.plugins.sampler.base import Sampler
from brushexp.plugins.sampler.whole import Whole
from brushexp.registry import build, build_named, keep_built, plugin_of, take_built
from brushexp.registry.blame import name_member
from brushexp.strokes.catalogue import Strokes, check_units
from brushexp.strokes.storage import load_catalogue
from brushexp.system.runtime import check_memory

log = logging.getLogger(__name__)
BYTES_PER_PIXEL = 500  # minimum memory of a painting; blend=tiled takes up to 800
BYTES_PER_WINDOW_PIXEL = 32  # bytes per pixel: RGBA in 32 bits and its gradient
STYLE, BRUSHWORK = "style", "brushwork"  # names of the losses added by keys of ``style``
LONG_MINUTES = 2  # duration beyond which slow steps are announced
MANY_DRAWINGS = 10_000  # number of drawings below which their time is not measured
PIXELS_OF_A_STROKE = 16  # minimum pixels per stroke where the number of strokes is chosen for the user
AUTO = "auto"  # value of warm_up that lets the renderer choose


@dataclass(frozen=True)
class Stage:
    """A number of gradient steps with one renderer; ``name`` is the renderer's name for messages."""

    name: str
    renderer: Renderer
    steps: int


@dataclass(frozen=True)
class Components:
    """The components of a painting: one member of each family, and a renderer for each stage."""

    stages: Sequence[Stage]
    blend: Compositor
    order: Order
    losses: Mapping[str, Loss]
    density: Density
    sampler: Sampler
    optimizer: Optimizer


def standard_components(
    renderer: Renderer | None = None, *, steps: int = 500, blend: Blend | None = None, color: ColorSpace | None = None,
    **chosen: Any,
) -> Components:  # fmt: skip
    """Build the default components of ``task=paint``; components in ``chosen`` replace the defaults."""
    renderer = renderer or Analytic()
    stages = [Stage(type(renderer).__name__.lower(), renderer, steps)]
    compositor = Compositor(blend or Tiled(), color or Rgb())
    default = Components(stages, compositor, Area(), {"mse": MeanSquaredError()}, Fixed(), Whole(), TorchOptim())
    return replace(default, **chosen)


def build_components(cfg: DictConfig) -> Components:
    """Build the components that a config chooses."""
    others = {family: take_built(cfg[family]) for family in ("order", "density", "sampler", "optimizer")}
    try:
        check_units(others["optimizer"].units)
    except UserError as error:
        raise UserError(f"{name_member('optimizer', others['optimizer'])}: {error}") from error
    blend = Compositor(take_built(cfg.blend), take_built(cfg.color))
    return Components(stages=build_stages(cfg), blend=blend, losses=build_losses(cfg), **others)


def build_losses(cfg: DictConfig) -> dict[str, Loss]:
    """Build the chosen losses and those added by ``style.image`` and ``style.brushwork``."""
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
    """Raise a UserError if two losses have the same name, or if a loss lacks its reference painting."""
    for key, name in (("image", STYLE), ("brushwork", BRUSHWORK)):
        if cfg.style[key] is not None and name in cfg.loss:
            raise UserError(f"style.{key}={cfg.style[key]} adds the loss {name} itself; drop {name} from loss=...")
    if BRUSHWORK in cfg.loss and cfg.loss[BRUSHWORK].catalogue is None:
        raise UserError("loss=brushwork needs a painting to compare with; set loss.brushwork.catalogue=catalogue.h5")


def build_stages(cfg: DictConfig, make: Callable[[DictConfig], Renderer] = take_built) -> list[Stage]:
    """Build the stages: a warm-up stage if ``warm_up`` requests one, then a stage with the chosen renderer."""
    name, renderer = plugin_of(cfg.renderer).name, make(cfg.renderer)
    first = renderer.warm_up if cfg.warm_up == AUTO else cfg.warm_up
    if first is None or not (cfg.steps or cfg.seconds):
        return [Stage(name, renderer, cfg.steps)]
    return [Stage(first, build_named("renderer", first, {}), cfg.steps), Stage(name, renderer, cfg.finish_steps)]


def plan_steps(
    parts: Components, steps_per_stroke: float | None, strokes: Strokes, size: tuple[int, int]
) -> Components:
    """Plan the steps for partial updates of ``strokes`` on a canvas of ``size`` (H, W).

    In the first stage, each stroke moves ``steps_per_stroke`` times; None keeps the number of steps. In a second stage,
    which uses a slow renderer, each stroke moves as many times as the config sets steps for that stage.
    """
    first, *others = parts.stages
    if steps_per_stroke is None and not others:
        return parts
    each = parts.sampler.steps_per_round(strokes, size)
    if steps_per_stroke is not None:
        first = replace(first, steps=round(steps_per_stroke * each))
    return replace(parts, stages=[first, *(replace(stage, steps=stage.steps * each) for stage in others)])


def check_size(cfg: DictConfig, strokes: int, size: tuple[int, int]) -> None:
    """Raise a UserError if a canvas of ``size`` (H, W) and the strokes' windows do not fit into memory."""
    pixels = math.prod(size)
    window = max(getattr(stage.renderer, "window", 0) for stage in build_stages(cfg, keep_built))
    windows = strokes * window**2 * BYTES_PER_WINDOW_PIXEL if isinstance(keep_built(cfg.sampler), Whole) else 0
    key = "working_resolution=" if cfg.resolution is None and cfg.working_resolution is not None else "resolution="
    smaller = f"{key}, or fewer strokes=" if windows else key
    what = f"{strokes} strokes on {size[1]} x {size[0]} pixels"
    check_memory(pixels * BYTES_PER_PIXEL + windows, what, f"choose a smaller {smaller}")


def warn_of_slow_steps(stages: Sequence[Stage], strokes: int) -> None:
    """Log the expected time of steps that take minutes on this machine because a network draws each stroke."""
    for stage in stages:
        if isinstance(stage.renderer, PatchRenderer) and strokes * stage.steps >= MANY_DRAWINGS:
            minutes = strokes * stage.steps * stage.renderer.seconds_per_stroke() / 60
            if minutes >= LONG_MINUTES:
                steps = f"{stage.steps} steps of {strokes:,} strokes with renderer={stage.name} take about"
                cure = f"less: {'finish_steps' if len(stages) > 1 else 'steps'}=5, strokes=300 or seconds=60"
                log.info("%s %d minutes; %s", steps, minutes, cure)


def first_strokes(
    cfg: DictConfig,
    target: Tensor,
    density: Density,
    focus: Tensor | None,
    faces: Sequence[Face] = (),
    features: Sequence[Feature] = (),
    *,
    painted: tuple[int, int] | None = None,
) -> tuple[Strokes, int]:
    """Load the strokes in ``catalogue``, or create them; return them and the final number of strokes.

    Strokes are created by ``init`` and shaped by ``style.brushwork``. Small strokes for ``features`` come last. If the
    user sets ``strokes``, the small strokes count towards that number; otherwise, they and the strokes that are
    restored to ``faces`` after abstraction are added to the look's own number. ``painted`` is the size (H, W) of the
    painting if the target is smaller.
    """
    _, height, width = target.shape
    painted = painted or (height, width)
    if cfg.catalogue is not None:
        if cfg.style.brushwork is not None:
            log.info("the strokes of %s are kept, so style.brushwork acts only as a loss", cfg.catalogue)
        strokes = load_strokes(Path(cfg.catalogue), (height, width))
        return strokes, stroke_budget(cfg, painted, density, len(strokes))
    n = stroke_budget(cfg, painted, density)
    if density.chooses_number and cfg.strokes is None:
        most = max(1, height * width // PIXELS_OF_A_STROKE)
        n = most if cfg.max_strokes is None else min(most, cfg.max_strokes)
    first = density.first(n, planned_steps(cfg))
    generator = torch.Generator().manual_seed(cfg.seed)
    initializer: Initializer = take_built(cfg.init)
    strokes = initializer(target, first, generator, focus)
    if cfg.strokes is None:
        kept = [face_strokes(initializer, target, face, n, cfg.abstraction, generator) for face in faces]
        strokes = Strokes.join(strokes, *kept)
        small = draw_features(target, features, strokes, generator)
        n += sum(map(len, kept)) + len(small)
    else:
        small = draw_features(target, features, strokes, generator, TYPED_SHARE * first)
        if len(small):
            strokes = initializer(target, first - len(small), generator, focus)
    if cfg.style.brushwork is not None:
        likeness: BrushworkLoss = build(cfg.style.strokes)
        strokes = likeness.arrange(strokes, (height, width), generator)
    return Strokes.join(strokes, small), n


def planned_steps(cfg: DictConfig) -> int:
    """Return a lower bound for the number of steps of a painting."""
    return cfg.steps if cfg.steps_per_stroke is None else round(cfg.steps_per_stroke)


def stroke_budget(cfg: DictConfig, size: tuple[int, int], density: Density, count: int | None = None) -> int:
    """Return the final number of strokes for a picture of ``size`` (H, W); ``count`` is the number in ``catalogue``.

    Raises a UserError if the picture has too few pixels for the strokes, if ``catalogue`` has too many strokes, or if
    it has too few and no density policy adds the others.
    """
    n = count if cfg.strokes is None else cfg.strokes
    if n is None:
        n = max(1, round(math.prod(size) / cfg.pixels_per_stroke))
        n = n if cfg.max_strokes is None else min(n, cfg.max_strokes)
    if count is not None and (n < count or (n > count and density.first(n, planned_steps(cfg)) == n)):
        raise UserError(
            f"strokes={n}, but {cfg.catalogue} has {count}; drop strokes or catalogue, or choose a policy that "
            "adds strokes, density=adaptive, and enough steps"
        )
    if count is None and n > math.prod(size):
        cure = f"set strokes to {math.prod(size)} at most, or enlarge the picture with resolution"
        raise UserError(f"strokes={n} is more than the {size[0]} x {size[1]} picture has pixels; {cure}")
    return n


def load_strokes(path: Path, size: tuple[int, int]) -> Strokes:
    """Load the strokes from a catalogue, bottom stroke first, scaled to a canvas of ``size`` (H, W)."""
    saved = load_catalogue(path)
    check_ratio(str(path), saved.size, size, "catalogue")
    return saved.strokes[saved.depth.argsort()].moved(zoom=max(size) / max(saved.size))
