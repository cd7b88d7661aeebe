"""What a painting is made with."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from brushexp.plugins.blend.base import Blend
from brushexp.plugins.density.base import Density
from brushexp.plugins.loss.base import Loss
from brushexp.plugins.optimizer.base import Optimizer
from brushexp.plugins.order.base import Order
from brushexp.plugins.renderer.base import Renderer
from brushexp.plugins.sampler.base import Sampler


@dataclass(frozen=True)
class Stage:
    """So many steps with one renderer.

    Attributes:
        name: of the renderer, for messages.
        renderer: draws the strokes.
        steps: gradient steps.
    """

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
