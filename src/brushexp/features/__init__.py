"""Feature networks: pictures -> named activations, for losses and for metrics. No network access, ever."""

from pathlib import Path

from brushexp.errors import UserError
from brushexp.features.base import OPTION, Backbone, packaged, read_tensors
from brushexp.features.classic import ARCHITECTURES, ClassicNetwork
from brushexp.features.efficientnet_lite import FILE, PACKAGE, EfficientNetLite0

NETWORKS = ("effl0", *ARCHITECTURES)  # what `open_backbone` knows


def open_backbone(name: str, weights: str | None = None, option: str = OPTION) -> Backbone:
    """Feature network ``name``, with the weights of the file ``weights`` or, where there is one, of its pip package.

    A UserError says what to install or to set if there is none; ``option`` is what sets the file.
    """
    if name == "effl0":
        return EfficientNetLite0(read_tensors(Path(weights) if weights else packaged(PACKAGE, FILE), option))
    if weights is None:
        raise UserError(
            f"backbone {name} needs a file with torchvision's weights, .pth or .safetensors; set {option}=path, "
            f"or take another network: {option.replace('weights', 'backbone')}=effl0"
        )
    return ClassicNetwork(name, read_tensors(Path(weights), option))
