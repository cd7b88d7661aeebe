"""Further losses, as members of the family ``loss``."""

from brushexp_losses import sinkhorn

__all__ = ["sinkhorn"]
