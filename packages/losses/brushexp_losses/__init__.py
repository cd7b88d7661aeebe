"""Further losses, as members of the family ``loss``."""

from brushexp_losses import curvature, direction, l1, perceptual, sinkhorn, ssim

__all__ = ["curvature", "direction", "l1", "perceptual", "sinkhorn", "ssim"]
