"""Renderers compute the area covered by each stroke; choose one with ``renderer=analytic``."""
