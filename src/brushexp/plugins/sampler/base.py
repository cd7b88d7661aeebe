"""Base class for samplers, which choose the part of the canvas and the strokes for a step."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import torch
from torch import Tensor

from brushexp.pictures.region import Region
from brushexp.strokes.catalogue import Strokes


class View:
    """The region that a step compares and the strokes that it moves; the painter's counterpart of a batch.

    ``region`` is the part of the canvas that the step renders and compares, or the whole canvas if ``active`` is None.
    The step moves the strokes with indices ``active`` (A,), int64, or all strokes if it is None, and also draws the
    strokes with indices ``ring`` (R,). A coarse step compares the whole canvas at ``zoom`` (below 1) times its size.
    """

    def __init__(
        self, region: Region, active: Tensor | None = None, ring: Tensor | None = None, *, zoom: float = 1.0
    ) -> None:
        self.region, self.active, self.ring, self.zoom = region, active, ring, zoom

    def to(self, device: Any) -> View:
        """Move the indices to a device, as Lightning does with batches."""
        active, ring = (None if numbers is None else numbers.to(device) for numbers in (self.active, self.ring))
        return View(self.region, active, ring, zoom=self.zoom)


class Sampler(ABC):
    """Decides which strokes a gradient step moves, and which part of the canvas it renders and compares.

    >>> class UpperHalf(Sampler):
    ...     cost, moves = "half", "those of the upper half"
    ...     def __call__(self, strokes, size, step, generator):
    ...         active = (strokes.position[:, 1] < size[0] / 2).nonzero()[:, 0]
    ...         return View(Region(0, 0, size[0] // 2, size[1]), active)
    >>> from brushexp.plugins.init.random import Random
    >>> strokes = Random()(torch.rand(3, 24, 32), 20, torch.Generator())
    >>> view = UpperHalf()(strokes, (24, 32), 0, torch.Generator())
    >>> view.region, bool((strokes.position[view.active, 1] < 12).all())
    (Region(top=0, left=0, height=12, width=32), True)
    """

    cost: ClassVar[str] = "not measured"  # cost of a step, relative to a step on the whole canvas
    moves: ClassVar[str] = "some"  # the strokes that a step moves

    @classmethod
    def facts(cls) -> dict[str, str]:
        return {"cost": cls.cost, "moves": cls.moves}

    @abstractmethod
    def __call__(self, strokes: Strokes, size: tuple[int, int], step: int, generator: torch.Generator) -> View:
        """Choose the view for a ``step`` (from 0), with a region inside a canvas of ``size`` (H, W).

        ``strokes`` have no gradient; all randomness comes from ``generator``.
        """

    def steps_per_round(self, strokes: Strokes, size: tuple[int, int]) -> int:
        """Return the number of steps in which each stroke moves about once on a canvas of ``size`` (H, W)."""
        return 1

    def state_dict(self) -> dict[str, Any]:
        """Return the tensors and numbers that a resumed run needs."""
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:  # noqa: B027
        """Restore the state that `state_dict` returned."""
