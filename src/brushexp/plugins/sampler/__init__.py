"""Samplers: which part of the canvas a step looks at. Pick one: ``sampler=whole``."""
