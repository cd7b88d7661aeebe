"""Feature networks: pictures -> named activations, for losses and for metrics. No network access, ever."""

from collections.abc import Callable

from brushexp.errors import UserError
from brushexp.features.alexnet import load_alexnet
from brushexp.features.base import Backbone
from brushexp.features.efficientnet_lite import load_effl0
from brushexp.features.squeezenet import load_squeeze
from brushexp.features.vgg import load_vgg16, load_vgg16_hed
from brushexp.features.weights import OPTION

BACKBONES: dict[str, Callable[[str | None, str], Backbone]] = {
    "effl0": load_effl0,
    "vgg16": load_vgg16,
    "vgg16-hed": load_vgg16_hed,
    "alexnet": load_alexnet,
    "squeeze": load_squeeze,
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
