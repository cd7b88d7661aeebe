"""Samplers choose the part of the canvas that a step compares; choose one with ``sampler=whole``."""
