"""Renderers compute what each stroke covers; choose one with ``renderer=analytic``."""
