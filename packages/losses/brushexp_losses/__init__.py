"""Further losses, as members of the family ``loss``."""

from brushexp_losses import curvature, direction, sinkhorn

__all__ = ["curvature", "direction", "sinkhorn"]
