"""Samplers: which part of the canvas one step looks at. Pick one: ``sampler=whole``."""
