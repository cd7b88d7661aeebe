"""A step over some of the strokes: rows of parameters and of the optimiser's state, sliced out and written back."""

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
STEP_COUNT = "step"  # under this name optimisers count their steps, to correct the bias of their first averages


@contextmanager
def partial_update(
    catalogue: Catalogue, optimizer: optim.Optimizer, rows: Tensor | None, visits: Tensor
) -> Iterator[Catalogue]:
    """Let an optimiser see only strokes number ``rows`` (A,), as a catalogue of their own; None for all of them.

    An optimiser that saw all strokes would move those too whose gradient is 0: their averages go on. What it remembers
    of a stroke goes with it if it is one number per parameter; what is not (the history of L-BFGS) starts afresh.
    ``visits`` (N,), the steps that each stroke has taken, are counted here; optimisers know one number of steps for all
    strokes of a step: the median.
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
    known = [(old, new, whole.get(old, {})) for old, new in pairs]
    sliced = {new: _sliced(state, steps, rows, old) for old, new, state in known if _is_by_row(state, old)}
    optimizer.state = defaultdict(dict, {new: state for new, state in sliced.items() if state})
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
    if not _written_back(whole, [(old, state.get(new, {})) for old, new in pairs], rows) and not visits.any():
        log.info("%s cannot remember single strokes: each step begins afresh", type(optimizer).__name__)
    visits[rows] += 1


@torch.no_grad()
def _written_back(whole: Any, states: list[tuple[nn.Parameter, dict[str, Any]]], rows: Tensor) -> bool:
    """Write the state of some strokes into that of all, if all of it is one number per parameter."""
    for old, state in states:
        shape = (len(rows), *old.shape[1:])
        if not all(torch.is_tensor(value) and value.shape in ((), shape) for value in state.values()):
            return False
    for old, state in states:
        kept = whole[old]
        for key, value in state.items():
            if value.ndim == 0:
                kept[key] = value
                continue
            if key not in kept:
                kept[key] = value.new_zeros(old.shape)
            kept[key][rows] = value
    return True


def _is_by_row(state: dict[str, Any], old: Tensor) -> bool:
    """Whether the state of a parameter can be divided: it is numbers, and tensors of one number for each of its own."""
    known = [value for key, value in state.items() if key != STEP_COUNT]
    return all(torch.is_tensor(value) and value.shape in ((), old.shape) for value in known)


def _sliced(state: dict[str, Any], steps: int, rows: Tensor, old: Tensor) -> dict[str, Any]:
    found = {}
    for key, value in state.items():
        if key == STEP_COUNT:
            found[key] = torch.full_like(value, steps) if torch.is_tensor(value) else steps
        else:
            found[key] = value[rows] if value.shape == old.shape and value.ndim else value.clone()
    return found


def unwrapped(optimizer: Any) -> optim.Optimizer:
    """PyTorch's optimiser below the one that Lightning passes."""
    return optimizer.optimizer if isinstance(optimizer, LightningOptimizer) else optimizer
