"""Samplers choose the part of the canvas to render and compare in a step; choose one with ``sampler=whole``."""
