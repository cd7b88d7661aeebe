"""Media: papers, palettes, marks of dry and flat brushes, dots and drawn lines, for ``look=watercolour`` and others."""

from brushexp_media import blurred, chroma, dots, drawing, marks, palettes, papers, rows, wet_steps

__all__ = ["blurred", "chroma", "dots", "drawing", "marks", "palettes", "papers", "rows", "wet_steps"]
