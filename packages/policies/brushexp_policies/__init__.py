"""Which strokes a step moves and a pixel shows, how they lie, when they come and go: rules that no default needs."""

from brushexp_policies import accuracy, adaptive, fixed, patches, strata, strays, topk, traced

__all__ = ["accuracy", "adaptive", "fixed", "patches", "strata", "strays", "topk", "traced"]
