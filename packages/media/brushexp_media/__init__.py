"""Media: papers, palettes, marks of brushes and chalk, dots and drawn lines, for ``look=watercolour`` and others."""

from brushexp_media import blurred, chalks, chroma, dots, drawing, marks, palettes, papers, rows

__all__ = ["blurred", "chalks", "chroma", "dots", "drawing", "marks", "palettes", "papers", "rows"]
