"""Feature networks: pictures -> named activations, for losses and for metrics. No network access, ever."""

from collections.abc import Callable
from functools import partial

from brushexp.errors import UserError
from brushexp.features.base import Backbone
from brushexp.features.classic import ALEXNET, SQUEEZENET, VGG16, load_classic, load_vgg16_hed
from brushexp.features.efficientnet_lite import load_effl0
from brushexp.features.weights import OPTION

BACKBONES: dict[str, Callable[[str | None, str], Backbone]] = {
    "effl0": load_effl0,
    "vgg16": partial(load_classic, VGG16),
    "vgg16-hed": load_vgg16_hed,
    "alexnet": partial(load_classic, ALEXNET),
    "squeeze": partial(load_classic, SQUEEZENET),
}


def open_backbone(name: str, weights: str | None = None, option: str = OPTION) -> Backbone:
    """Feature network ``name``, with the weights of the file ``weights`` or, where there is one, of its pip package.

    Args:
        name: of the network.
        weights: a file.
        option: what sets it, for messages.

    Raises:
        UserError: if there is no such network, or no weights for it; it says what to install or to set.
    """
    if name not in BACKBONES:
        raise UserError(f"backbone={name} is not a feature network; choose one of {', '.join(BACKBONES)}")
    return BACKBONES[name](weights, option)
