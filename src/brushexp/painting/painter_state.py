"""What a checkpoint holds of a painter beside its strokes and the optimiser, so that a resumed run is the same run."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import torch

from brushexp.painting.anytime import Anytime

if TYPE_CHECKING:
    from brushexp.painting.painter import Painter


def painter_state(painter: Painter) -> dict[str, Any]:
    """The state of a painter: tensors, numbers, and lists and dictionaries of them."""
    memory = painter.picture.memory
    return {
        "stage": painter.stage,
        "schedule": painter.schedule.state_dict(),
        "depth": painter.depth.state_dict(),
        "sampler": painter.components.sampler.state_dict(),
        "density": painter.components.density.state_dict(),
        "evaluations": painter.evaluations,
        "visits": painter.visits,
        "picture": None if memory is None else memory.picture,
        "anytime": painter.anytime.pairs,
        "generator": painter.generator.get_state(),
        "torch": torch.get_rng_state(),
    }


def load_painter_state(painter: Painter, state: dict[str, Any]) -> None:
    """Take over what `painter_state` gave; the strokes come after it, into a catalogue that now has their number."""
    device = painter.picture.target.device
    painter.use_stage(state["stage"])
    painter.catalogue.resize(len(state["visits"]))
    painter.schedule.load_state_dict(state["schedule"])
    painter.depth.load_state_dict(state["depth"], device)
    painter.components.sampler.load_state_dict(state["sampler"])
    painter.components.density.load_state_dict(state["density"])
    painter.evaluations, painter.visits = state["evaluations"], state["visits"].to(device)
    painter.anytime = Anytime(state["anytime"])
    if state["picture"] is not None:
        painter.picture.remember(state["picture"].to(device), len(painter.catalogue))
    painter.generator.set_state(state["generator"])
    torch.set_rng_state(state["torch"])
