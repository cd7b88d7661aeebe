"""Further losses, as members of the family ``loss``."""

from brushexp_losses import curvature, sinkhorn

__all__ = ["curvature", "sinkhorn"]
