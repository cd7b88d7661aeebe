"""Feature networks: pictures -> named activations, for losses and for metrics. No network access, ever."""

from collections.abc import Callable
from functools import partial

from brushexp.errors import UserError
from brushexp.features.base import OPTION, Backbone
from brushexp.features.classic import ARCHITECTURES, load_classic
from brushexp.features.efficientnet_lite import load_effl0

BACKBONES: dict[str, Callable[[str | None, str], Backbone]] = {
    "effl0": load_effl0,
    **{name: partial(load_classic, name) for name in ARCHITECTURES},
}


def open_backbone(name: str, weights: str | None = None, option: str = OPTION) -> Backbone:
    """Feature network ``name``, with the weights of the file ``weights`` or, where there is one, of its pip package.

    ``option`` is what sets the file, for messages.

    Raises:
        UserError: if there is no such network, or no weights for it; it says what to install or to set.
    """
    if name not in BACKBONES:
        raise UserError(f"backbone={name} is not a feature network; choose one of {', '.join(BACKBONES)}")
    return BACKBONES[name](weights, option)
