"""Further losses, as members of the family ``loss``."""

from brushexp_losses import curvature, direction, kl, l1, perceptual, sinkhorn, ssim, width

__all__ = ["curvature", "direction", "kl", "l1", "perceptual", "sinkhorn", "ssim", "width"]
