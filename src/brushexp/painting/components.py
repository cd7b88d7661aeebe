"""What a painting is made with: one member of each family that gradient steps need."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from omegaconf import DictConfig

from brushexp.errors import UserError
from brushexp.plugins.blend.base import Blend, Compositor
from brushexp.plugins.color.base import ColorSpace
from brushexp.plugins.density.base import Density
from brushexp.plugins.loss.base import Loss
from brushexp.plugins.optimizer.base import Optimizer
from brushexp.plugins.order.base import Order
from brushexp.plugins.renderer.base import Renderer
from brushexp.plugins.sampler.base import Sampler
from brushexp.plugins.sampler.whole import Whole
from brushexp.registry import build_named, keep_built, plugin_of, take_built
from brushexp.strokes.catalogue import Strokes
from brushexp.system.runtime import check_memory

BYTES_PER_PIXEL = 500  # that painting takes at least; blend=tiled was seen to take 800
BYTES_PER_WINDOW_PIXEL = 32  # RGBA in 32 bits, and its gradient
STYLE, BRUSHWORK = "style", "brushwork"  # names of the losses that the keys of ``style`` add
AUTO = "auto"  # warm_up that leaves it to the renderer


@dataclass(frozen=True)
class Stage:
    """So many gradient steps with one renderer, by its name in messages."""

    name: str
    renderer: Renderer
    steps: int


@dataclass(frozen=True)
class Components:
    """What a painting is made with: one member of each family, but one renderer for each stage."""

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
    """The defaults of ``task=paint`` without a config, for use from Python; ``chosen`` components differ."""
    from brushexp.plugins.blend.tiled import Tiled  # noqa: PLC0415  (the contracts above are all that others need)
    from brushexp.plugins.color.rgb import Rgb  # noqa: PLC0415
    from brushexp.plugins.density.fixed import Fixed  # noqa: PLC0415
    from brushexp.plugins.loss.mse import MeanSquaredError  # noqa: PLC0415
    from brushexp.plugins.optimizer.torch import TorchOptim  # noqa: PLC0415
    from brushexp.plugins.order.area import Area  # noqa: PLC0415
    from brushexp.plugins.renderer.analytic import Analytic  # noqa: PLC0415

    renderer = renderer or Analytic()
    stages = [Stage(type(renderer).__name__.lower(), renderer, steps)]
    compositor = Compositor(blend or Tiled(), color or Rgb())
    default = Components(stages, compositor, Area(), {"mse": MeanSquaredError()}, Fixed(), Whole(), TorchOptim())
    return replace(default, **chosen)


def build_components(cfg: DictConfig) -> Components:
    """Build what the config names."""
    others = {family: take_built(cfg[family]) for family in ("order", "density", "sampler", "optimizer")}
    blend = Compositor(take_built(cfg.blend), take_built(cfg.color))
    return Components(stages=build_stages(cfg), blend=blend, losses=build_losses(cfg), **others)


def build_losses(cfg: DictConfig) -> dict[str, Loss]:
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
    """Stop with a UserError if two losses of `build_losses` would have one name, or one nothing to compare with."""
    for key, name in (("image", STYLE), ("brushwork", BRUSHWORK)):
        if cfg.style[key] is not None and name in cfg.loss:
            raise UserError(f"style.{key}={cfg.style[key]} brings the loss {name} with it; drop {name} from loss=...")
    if BRUSHWORK in cfg.loss and cfg.loss[BRUSHWORK].catalogue is None:
        raise UserError("loss=brushwork has nothing to compare with; set loss.brushwork.catalogue=catalogue.h5")


def build_stages(cfg: DictConfig, make: Callable[[DictConfig], Renderer] = take_built) -> list[Stage]:
    """The renderers and their steps: the chosen one, and before it the one that ``warm_up`` asks for, if any."""
    name, renderer = plugin_of(cfg.renderer).name, make(cfg.renderer)
    first = renderer.warm_up if cfg.warm_up == AUTO else cfg.warm_up
    if first is None or not (cfg.steps or cfg.seconds):
        return [Stage(name, renderer, cfg.steps)]
    return [Stage(first, build_named("renderer", first, {}), cfg.steps), Stage(name, renderer, cfg.finish_steps)]


def plan_steps(
    parts: Components, steps_per_stroke: float | None, strokes: Strokes, size: tuple[int, int]
) -> Components:
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
    window = max(getattr(stage.renderer, "window", 0) for stage in build_stages(cfg, keep_built))
    windows = strokes * window**2 * BYTES_PER_WINDOW_PIXEL if isinstance(keep_built(cfg.sampler), Whole) else 0
    smaller = "resolution=, fewer strokes= or sampler=patches" if windows else "resolution="
    what = f"{strokes} strokes on {size[1]} x {size[0]} pixels"
    check_memory(pixels * BYTES_PER_PIXEL + windows, what, f"choose a smaller {smaller}")
