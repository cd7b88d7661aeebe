"""Renderers compute the area that each stroke covers; choose one with ``renderer=analytic``."""
