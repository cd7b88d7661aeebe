"""A step that is not taken: what is compiled or loaded at first use is then there, and its time is not counted."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch

if TYPE_CHECKING:
    from brushexp.painting.painter import Painter


def rehearse(painter: Painter) -> None:
    """Go through a step of a painter, forwards and backwards, and leave the painter as it was."""
    sampler, picture, catalogue = painter.components.sampler, painter.picture, painter.catalogue
    memory = picture.memory
    before = sampler.state_dict(), painter.generator.get_state(), painter.coarse, painter.evaluations
    if memory is not None:
        picture.remember(memory.picture.clone(), len(catalogue))
    painter.coarse = 0.0
    with torch.random.fork_rng(devices=[painter.device] if painter.device.type == "cuda" else []):
        strokes = painter.strokes()
        view = painter.next_view(strokes)
        painter.look_at(view, strokes, catalogue if view.active is None else catalogue.part(view.active))
        with torch.enable_grad():
            painter.training_step(None, 0).backward()
        if painter.components.density.uses_importance:
            painter.densification.state(painter.strokes()).importance()
    painter.zero_grad()
    picture.memory = picture.memory if memory is None else memory
    state, generator, painter.coarse, painter.evaluations = before
    sampler.load_state_dict(state)
    painter.generator.set_state(generator)
