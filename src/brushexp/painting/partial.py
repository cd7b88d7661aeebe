"""A step over some of the strokes: rows of parameters and of optimiser state, lent and taken back."""

from typing import Any

import torch
from torch import Tensor, nn, optim

from brushexp.plugins.optimizer.base import Optimizer
from brushexp.strokes.catalogue import Catalogue

STEP = "step"  # under this name optimisers count their steps, to correct the bias of their first averages


def lend(
    catalogue: Catalogue, optimizer: optim.Optimizer, make: Optimizer, rows: Tensor, steps: int
) -> tuple[Catalogue, optim.Optimizer]:
    """Strokes number ``rows`` (A,) as a catalogue of their own, with an optimiser that knows their past.

    An optimiser that saw all strokes would move those too whose gradient is 0: their averages go on. What it remembers
    of a stroke is lent if it is one number per parameter; what is not (the history of L-BFGS) starts afresh.

    Args:
        catalogue: all strokes.
        optimizer: of all strokes; it holds their state and takes no steps itself.
        make: makes such optimisers.
        rows: strokes, without repetition.
        steps: how many each of them has taken (the median, if they differ).
    """
    part = catalogue.part(rows)
    lent = make.over(p for p in part.parameters() if p.requires_grad)
    for old, new in _pairs(optimizer, lent):
        state = optimizer.state.get(old, {})
        lent.state[new] = {key: _counted(key, value, steps, rows, old) for key, value in state.items()}
    for group, wanted in zip(optimizer.param_groups, lent.param_groups, strict=True):
        wanted |= {key: steps if key == STEP else value for key, value in group.items() if key != "params"}
    return part, lent


@torch.no_grad()
def take_back(
    catalogue: Catalogue, optimizer: optim.Optimizer, part: Catalogue, lent: optim.Optimizer, rows: Tensor
) -> bool:
    """Write what `lend` gave away, and what has become of it, into the whole.

    Returns:
        Whether the optimiser's state came back, too; if not it starts afresh with the next step.
    """
    catalogue.put(rows, part)
    pairs = [(old, new, lent.state.get(new, {})) for old, new in _pairs(optimizer, lent)]
    if not all(_is_by_row(value, new) for _, new, state in pairs for value in state.values()):
        return False
    for old, _, state in pairs:
        kept = optimizer.state[old]
        for key, value in state.items():
            if value.ndim == 0:
                kept[key] = value
                continue
            if key not in kept:
                kept[key] = value.new_zeros(old.shape)
            kept[key][rows] = value
    for group, changed in zip(optimizer.param_groups, lent.param_groups, strict=True):
        group |= {key: value for key, value in changed.items() if key != "params"}
    return True


def _pairs(whole: optim.Optimizer, part: optim.Optimizer) -> list[tuple[nn.Parameter, nn.Parameter]]:
    """Each parameter of all strokes, and the one of some of them."""
    groups = zip(whole.param_groups, part.param_groups, strict=True)
    return [pair for old, new in groups for pair in zip(old["params"], new["params"], strict=True)]


def _is_by_row(value: Any, parameter: Tensor) -> bool:
    return torch.is_tensor(value) and value.shape in ((), parameter.shape)


def _counted(key: str, value: Any, steps: int, rows: Tensor, old: Tensor) -> Any:
    if key == STEP:
        return torch.full_like(value, steps) if torch.is_tensor(value) else steps
    return value[rows] if value.shape == old.shape and value.ndim else value.clone()
