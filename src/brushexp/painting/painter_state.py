"""What a painter is beside its strokes and the optimiser: saved for a resumed run, or kept while kernels compile."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import torch

from brushexp.painting.densification import importance
from brushexp.plugin_errors import OURS
from brushexp.plugins.loss.base import restore, state_of

if TYPE_CHECKING:
    from brushexp.painting.painter import Painter

_compiled: set[object] = set()  # what painters of this process were made of, see `_kind`


def painter_state(painter: Painter) -> dict[str, Any]:
    """The state of a painter: tensors, numbers, and lists and dictionaries of them."""
    memory = painter.picture.memory
    return {
        "stage": painter.stage,
        "schedule": painter.schedule.state_dict(),
        "depth": painter.depth.state_dict(),
        "sampler": painter.components.sampler.state_dict(),
        "density": painter.components.density.state_dict(),
        "losses": state_of(painter.components.losses),
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
    restore(painter.components.losses, state["losses"])
    painter.evaluations, painter.visits = state["evaluations"], state["visits"].to(device)
    painter.anytime.pairs = [(float(seconds), float(psnr)) for seconds, psnr in state["anytime"]]
    if state["picture"] is not None:
        painter.picture.memory = painter.picture.remembered(state["picture"].to(device))
    painter.generator.set_state(state["generator"])
    torch.set_rng_state(state["torch"])


def compile_kernels(painter: Painter) -> None:
    """Compile and load what a step needs, before the clock starts, by going through one that moves nothing.

    Numba compiles at first use (ten seconds and more after installation), losses open their networks: a run of so many
    ``seconds`` must not spend them on that, and the speed that it plans with is read off its first steps. After another
    painter of the same parts the picture is only looked at.
    """
    sampler, picture, catalogue = painter.components.sampler, painter.picture, painter.catalogue
    memory = picture.memory
    before = sampler.state_dict(), painter.generator.get_state(), painter.coarse, painter.evaluations
    remembered = state_of(painter.components.losses)
    if memory is not None:
        picture.memory = picture.remembered(memory.picture.clone())
    painter.coarse = 0.0
    made_of = painter.device.type, _kind(painter.renderer), _kind(painter.components)
    is_new = made_of not in _compiled
    with torch.random.fork_rng(devices=[painter.device] if painter.device.type == "cuda" else []):
        strokes = painter.strokes()
        view = painter.next_view(strokes)
        painter.look_at(view, strokes, catalogue if view.active is None else catalogue.part(view.active))
        with torch.set_grad_enabled(is_new):
            loss = painter.training_step(None, 0)
        if is_new:
            loss.backward()
        if is_new and painter.components.density.uses_importance:
            one = painter.strokes()[:1]  # enough for the kernels
            importance(one, torch.arange(len(one), device=painter.device), picture, painter.generator)
    _compiled.add(made_of)
    painter.zero_grad()
    picture.memory = memory or picture.memory
    state, generator, painter.coarse, painter.evaluations = before
    sampler.load_state_dict(state)
    restore(painter.components.losses, remembered)
    painter.generator.set_state(generator)


def _kind(part: Any) -> object:
    """The class and the options of a part, and of those inside it: they decide what is compiled and opened for it."""
    if part is None or isinstance(part, bool | int | float | str):
        return part
    if isinstance(part, dict):
        return tuple((key, _kind(value)) for key, value in part.items())
    is_ours = type(part).__module__.startswith(OURS)
    return type(part), _kind(vars(part)) if is_ours else ()
