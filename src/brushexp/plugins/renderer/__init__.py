"""Renderers: stroke parameters -> what each stroke covers. Pick one: ``renderer=analytic``."""
