"""What a painting is made with."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from brushexp.plugins.blend.base import Blend
from brushexp.plugins.density.base import Density
from brushexp.plugins.loss.base import Loss
from brushexp.plugins.optimizer.base import Optimizer
from brushexp.plugins.order.base import Order
from brushexp.plugins.renderer.base import Renderer
from brushexp.plugins.sampler.base import Sampler


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
    blend: Blend
    order: Order
    losses: Mapping[str, Loss]
    density: Density
    sampler: Sampler
    optimizer: Optimizer


def standard_components(renderer: Renderer | None = None, *, steps: int = 500, **chosen: Any) -> Components:
    """The defaults of ``task=paint`` without a config, for use from Python; ``chosen`` components differ."""
    from brushexp.plugins.blend.tiled import Tiled  # noqa: PLC0415  (the contracts above are all that others need)
    from brushexp.plugins.density.fixed import Fixed  # noqa: PLC0415
    from brushexp.plugins.loss.mse import MeanSquaredError  # noqa: PLC0415
    from brushexp.plugins.optimizer.torch import TorchOptim  # noqa: PLC0415
    from brushexp.plugins.order.area import Area  # noqa: PLC0415
    from brushexp.plugins.renderer.analytic import Analytic  # noqa: PLC0415
    from brushexp.plugins.sampler.whole import Whole  # noqa: PLC0415

    renderer = renderer or Analytic()
    stages = [Stage(type(renderer).__name__.lower(), renderer, steps)]
    default = Components(stages, Tiled(), Area(), {"mse": MeanSquaredError()}, Fixed(), Whole(), TorchOptim())
    return replace(default, **chosen)
