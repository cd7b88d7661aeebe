"""Update some of the strokes: slice parameters and optimiser state, and write them back."""

import logging
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch
from lightning.pytorch.core.optimizer import LightningOptimizer
from torch import Tensor, nn, optim

from brushexp.strokes.catalogue import Catalogue

log = logging.getLogger(__name__)
STEP_COUNT = "step"  # name under which optimisers store their step count


@contextmanager
def partial_update(
    catalogue: Catalogue, optimizer: optim.Optimizer, rows: Tensor | None, visits: Tensor
) -> Iterator[Catalogue]:
    """Restrict an optimiser to the strokes with indices ``rows`` (A,), yielded as a separate catalogue.

    If ``rows`` is None, all strokes are optimised. Given the whole catalogue, the optimiser would also move strokes
    whose gradient is 0, because of its running averages. The optimiser's state for a stroke is kept if it has one
    number per parameter; any other state (such as the history of L-BFGS) is reset. ``visits`` (N,) counts the steps of
    each stroke; its median over ``rows`` becomes the optimiser's step count.
    """
    if rows is None:
        yield catalogue
        visits += 1
        return
    part = catalogue.part(rows)
    names = {id(parameter): name for name, parameter in catalogue.named_parameters()}
    before = [(group, group["params"]) for group in optimizer.param_groups]
    pairs = [(old, getattr(part, names[id(old)])) for _, olds in before for old in olds]
    whole, steps = optimizer.state, int(visits[rows].median())
    optimizer.state = defaultdict(dict)
    for old, new in pairs:
        state = whole.get(old, {})
        if state and _has_shapes({key: state[key] for key in state if key != STEP_COUNT}, old.shape):
            optimizer.state[new] = _slice_state(state, steps, rows, old)
    for group, olds in before:
        group["params"] = [getattr(part, names[id(old)]) for old in olds]
        if STEP_COUNT in group:
            group[STEP_COUNT] = steps
    try:
        yield part
    finally:
        state, optimizer.state = optimizer.state, whole
        for group, olds in before:
            group["params"] = olds
    catalogue.put(rows, part)
    if not _write_back(whole, [(old, state.get(new, {})) for old, new in pairs], rows) and not visits.any():
        log.info("%s keeps no state per stroke, so every step starts afresh", type(optimizer).__name__)
    visits[rows] += 1


@torch.no_grad()
def _write_back(whole: Any, states: list[tuple[nn.Parameter, dict[str, Any]]], rows: Tensor) -> bool:
    """Write the state of the strokes in ``rows`` back into the full state, if it has one number per parameter."""
    if not all(_has_shapes(state, (len(rows), *old.shape[1:])) for old, state in states):
        return False
    for old, state in states:
        for key, value in state.items():
            if value.ndim == 0:
                whole[old][key] = value
            else:
                whole[old].setdefault(key, value.new_zeros(old.shape))[rows] = value
    return True


def _has_shapes(state: dict[str, Any], shape: tuple[int, ...]) -> bool:
    return all(torch.is_tensor(value) and value.shape in ((), shape) for value in state.values())


def _slice_state(state: dict[str, Any], steps: int, rows: Tensor, old: Tensor) -> dict[str, Any]:
    part = {}
    for key, value in state.items():
        if key == STEP_COUNT:
            part[key] = torch.full_like(value, steps) if torch.is_tensor(value) else steps
        else:
            part[key] = value[rows] if value.shape == old.shape and value.ndim else value.clone()
    return part


def unwrap_optimizer(optimizer: Any) -> optim.Optimizer:
    """Return the PyTorch optimiser that Lightning has wrapped."""
    return optimizer.optimizer if isinstance(optimizer, LightningOptimizer) else optimizer
