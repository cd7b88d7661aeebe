"""Report losses whose gradient does not reach any stroke, before the first step is taken."""

import logging
from collections.abc import Iterable, Mapping

from torch import Tensor, nn

from brushexp.errors import UserError
from brushexp.plugins.loss.base import Loss
from brushexp.registry.blame import name_member

CURE = "compute it from view.image or view.strokes without .detach(), .item(), NumPy or comparisons"

log = logging.getLogger(__name__)


def check_dependence(losses: Mapping[str, Loss], terms: Mapping[str, Tensor], *, shapes_move: bool) -> None:
    """Raise a UserError if no loss depends on a moving stroke; otherwise, log a warning for each loss that does not.

    ``terms`` are the values of the losses for a painting in which some strokes move. Unless ``shapes_move``, a loss
    that looks only at strokes is not reported, because it may depend on fields that the optimiser does not move.
    """
    without = [name for name, term in terms.items() if not term.requires_grad]
    told = {name: name_member("loss", losses[name], name) for name in without}
    if without and len(without) == len(terms):
        raise UserError(f"{', '.join(told.values())}: no gradient reaches the strokes, so no stroke would move; {CURE}")
    for name, who in told.items():
        if shapes_move or losses[name].looks_at != "strokes":
            log.warning("%s has no effect, because its gradient reaches no stroke; %s", who, CURE)


def check_slope(losses: Mapping[str, Loss], loss: Tensor, parameters: Iterable[nn.Parameter]) -> None:
    """Warn, after ``backward``, if the objective is not 0 but its gradient is, for example because of rounding."""
    slopes = [parameter.grad for parameter in parameters if parameter.grad is not None and len(parameter)]
    if slopes and bool(loss.detach()) and not any(bool(slope.any()) for slope in slopes):
        names = ", ".join(name_member("loss", one, name) for name, one in losses.items())
        log.warning("%s: the gradient is 0 for all strokes at the start, so no stroke moves until that changes", names)
