"""Simulators of wet paint, as members of the family ``engine``."""

from brushexp_training.engine import fluid, wash

__all__ = ["fluid", "wash"]
