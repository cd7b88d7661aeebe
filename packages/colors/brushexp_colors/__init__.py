"""Spaces other than RGB in which paint is laid over paint, as members of the family ``color``."""

from brushexp_colors import linear, oklab, pigment

__all__ = ["linear", "oklab", "pigment"]
