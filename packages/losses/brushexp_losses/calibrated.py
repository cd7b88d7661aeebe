"""Load LPIPS with its published weights, or the distance in the feature space of the bundled network."""

from brushexp.contracts.pictures import Distance, bundled_distance, open_backbone, packaged_file, read_tensors

# The published channel weights (LPIPS 0.1), which ship with torchmetrics, and the activations to which they apply.
PACKAGE, FOLDER = "torchmetrics", "functional/image/lpips_models"
CALIBRATED = {
    "alexnet": ("alex.pth", ("relu1", "relu2", "relu3", "relu4", "relu5")),
    "squeeze": ("squeeze.pth", ("relu1", "fire3", "fire5", "fire6", "fire7", "fire8", "fire9")),
    "vgg16": ("vgg.pth", ("relu1_2", "relu2_2", "relu3_3", "relu4_3", "relu5_3")),
}


def open_distance(backbone: str, weights: str | None, option: str = "loss.lpips.weights") -> Distance:
    """Load the bundled distance or, for other backbones, LPIPS with published weights; errors name ``option``."""
    if backbone == "effl0":
        return bundled_distance(weights, option)
    network = open_backbone(backbone, weights, option)
    file, taps = CALIBRATED[backbone]
    published = read_tensors(packaged_file(PACKAGE, f"{FOLDER}/{file}"))
    tensors = {tap: published[f"lin{number}.model.1.weight"].flatten() for number, tap in enumerate(taps)}
    return Distance(network, tensors, f"lpips-{backbone}")
