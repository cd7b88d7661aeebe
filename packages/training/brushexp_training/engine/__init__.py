"""Brush simulators, as members of the family ``engine``."""

from brushexp_training.engine import disc, fluid, wash

__all__ = ["disc", "fluid", "wash"]
