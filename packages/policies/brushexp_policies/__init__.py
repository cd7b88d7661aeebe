"""Which strokes a step moves, in what order they lie, and when they come and go, by rules that no default needs."""

from brushexp_policies import accuracy, patches, strays, traced

__all__ = ["accuracy", "patches", "strays", "traced"]
