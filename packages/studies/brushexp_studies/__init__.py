"""Compare settings: paired differences, fronts, curves and effects of sweeps, and ``task=compare``."""
