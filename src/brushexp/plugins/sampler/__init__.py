"""Samplers: which part of the canvas a step compares. Choose one: ``sampler=whole``."""
