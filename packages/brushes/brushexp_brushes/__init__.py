"""Brushes of one's own: scanned strokes and the brushes of GIMP, as ``renderer=brush`` and ``brush=stroke.png``."""

from brushexp_brushes import brush

__all__ = ["brush"]
