"""Renderers: stroke parameters -> what each stroke covers. Choose one: ``renderer=analytic``."""
