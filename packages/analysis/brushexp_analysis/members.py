"""Members of families: the strokes as a table (``to=csv``), and the size of them in bits."""

from brushexp_analysis import bits, stroke_lines

__all__ = ["bits", "stroke_lines"]
