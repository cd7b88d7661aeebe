"""Feature networks for losses and metrics; they map pictures to named activations and work offline."""

from pathlib import Path

from brushexp.errors import UserError
from brushexp.features.base import OPTION, Backbone, packaged_file, read_tensors
from brushexp.features.efficientnet_lite import FILE, PACKAGE, EfficientNetLite0
from brushexp.system.published import entry_points_of

PUBLISHED = entry_points_of("brushexp.networks")  # functions that build a network from its name and tensors
NETWORKS = ("effl0", *PUBLISHED)  # names that `open_backbone` accepts


def open_backbone(name: str, weights: str | None = None, option: str = OPTION) -> Backbone:
    """Load a feature network with weights from a file or, if it has one, from its pip package.

    Raises a UserError that states what to install or set if no weights are found; ``option`` is the key that sets the
    file.
    """
    if name == "effl0":
        return EfficientNetLite0(read_tensors(Path(weights) if weights else packaged_file(PACKAGE, FILE), option))
    if weights is None:
        raise UserError(
            f"backbone {name} needs a file with torchvision's weights, .pth or .safetensors; set {option}=path, "
            f"or choose another network: {option.replace('weights', 'backbone')}=effl0"
        )
    network: Backbone = PUBLISHED[name].load()(name, read_tensors(Path(weights), option))
    return network
