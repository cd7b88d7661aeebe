"""What the density policy sees after a step, and the change of the set of strokes that it asks for."""

from __future__ import annotations

from functools import partial

import torch
from torch import Tensor, optim

from brushexp.painting.depth import Depth
from brushexp.painting.importance import importance
from brushexp.painting.picture import Picture
from brushexp.painting.schedule import Schedule
from brushexp.plugins.density.base import DensificationState, Density
from brushexp.strokes.catalogue import Catalogue, Strokes


class Densification:
    """Asks a density policy after each step, and adds and removes strokes as it says.

    Args:
        density: the policy.
        budget: strokes that it may come to.
        picture: what is painted.
        depth: of the strokes.
        schedule: of the steps.
        generator: of everything random.
    """

    def __init__(
        self,
        density: Density,
        budget: int,
        picture: Picture,
        depth: Depth,
        schedule: Schedule,
        generator: torch.Generator,
    ) -> None:
        self.density = density
        self.budget = budget
        self.picture = picture
        self.depth = depth
        self.schedule = schedule
        self.generator = generator

    def state(self, strokes: Strokes) -> DensificationState:
        """The painting of N strokes as the policy sees it."""
        picture, front_to_back = self.picture, self.depth.front_to_back
        image = picture.draw(strokes, front_to_back) if picture.last is None else picture.last
        judge = partial(
            importance, strokes, front_to_back, picture.target, picture.focus, picture.background,
            picture.renderer, picture.blend, self.generator,
        )  # fmt: skip
        size = (self.budget, self.schedule.step, self.schedule.steps)
        return DensificationState(image, picture.target, picture.focus, strokes, *size, judge)

    def update(self, catalogue: Catalogue, visits: Tensor, optimizer: optim.Optimizer) -> Tensor:
        """Let the policy change the strokes of a catalogue, if it wants to now.

        Args:
            catalogue: the N strokes; changed in place.
            visits: (N,) steps that each stroke has taken.
            optimizer: of the strokes; what it remembers of those that stay is kept.

        Returns:
            (N',) visits of the strokes that there are now.
        """
        schedule = self.schedule
        if not self.density.due(schedule.step, schedule.steps):
            return visits
        with torch.no_grad():
            strokes = catalogue()
        update = self.density.revise(self.state(strokes))
        if update is None:
            return visits
        catalogue.revise(update.keep, self.picture.renderer.convert(update.new), optimizer)
        self.depth.accuracy = None
        self.picture.forget()
        self.depth.renew(catalogue())
        # New strokes count as often moved as the oldest: the optimiser counts their steps together.
        new = visits.new_full((len(update.new),), int(visits.max()) if len(visits) else 0)
        return torch.cat([visits[update.keep], new])
