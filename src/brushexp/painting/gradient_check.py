"""Tell before the first step of losses whose gradient reaches no stroke."""

import logging
from collections.abc import Iterable, Mapping

from torch import Tensor, nn

from brushexp.errors import UserError
from brushexp.plugins.loss.base import Loss
from brushexp.registry.blame import name_member

CURE = "compute it from view.image or view.strokes, without .detach(), .item(), NumPy or a comparison"

log = logging.getLogger(__name__)


def check_dependence(losses: Mapping[str, Loss], terms: Mapping[str, Tensor], *, shapes_move: bool) -> None:
    """Refuse (UserError) losses of which none depends on a stroke that moves, and warn of a single one.

    ``terms`` are their values of a painting in which some stroke moves. A loss of the strokes alone may depend on
    fields that the optimiser leaves as they are, unless ``shapes_move``.
    """
    without = [name for name, term in terms.items() if not term.requires_grad]
    told = {name: name_member("loss", losses[name], name) for name in without}
    if without and len(without) == len(terms):
        raise UserError(f"{', '.join(told.values())}: no gradient reaches a stroke, so that none would move; {CURE}")
    for name, who in told.items():
        if shapes_move or losses[name].looks_at != "strokes":
            log.warning("%s: its gradient reaches no stroke, so that it changes nothing; %s", who, CURE)


def check_slope(losses: Mapping[str, Loss], loss: Tensor, parameters: Iterable[nn.Parameter]) -> None:
    """Warn of an objective that is not 0 but has a gradient of 0, as one of rounded numbers has; after ``backward``."""
    slopes = [parameter.grad for parameter in parameters if parameter.grad is not None and len(parameter)]
    if slopes and bool(loss.detach()) and not any(bool(slope.any()) for slope in slopes):
        names = ", ".join(name_member("loss", one, name) for name, one in losses.items())
        log.warning("%s: the gradient is 0 for all strokes at the start, so that none moves until that changes", names)
