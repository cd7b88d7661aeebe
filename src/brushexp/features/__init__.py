"""Feature networks: pictures -> named activations, for losses and for metrics. No network access, ever."""

from brushexp.errors import UserError
from brushexp.features.base import Backbone
from brushexp.features.efficientnet_lite import load_effl0
from brushexp.features.vgg import load_vgg16, load_vgg16_hed

BACKBONES = {"effl0": load_effl0, "vgg16": load_vgg16, "vgg16-hed": load_vgg16_hed}


def open_backbone(name: str, weights: str | None = None) -> Backbone:
    """Feature network ``name``, with the weights of the file ``weights`` or, where there is one, of its pip package.

    Raises:
        UserError: if there is no such network, or no weights for it; it says what to install or to set.
    """
    if name not in BACKBONES:
        raise UserError(f"backbone={name} is not a feature network; choose one of {', '.join(BACKBONES)}")
    return BACKBONES[name](weights)
