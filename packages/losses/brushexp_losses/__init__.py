"""Further losses, as members of the family ``loss``."""

from brushexp_losses import curvature, direction, perceptual, sinkhorn, ssim

__all__ = ["curvature", "direction", "perceptual", "sinkhorn", "ssim"]
