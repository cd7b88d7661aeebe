"""Members of families: the strokes as a table and as text (``to=csv``, ``to=json``), and their size in bits."""

from brushexp_analysis import bits, stroke_lines, stroke_text

__all__ = ["bits", "stroke_lines", "stroke_text"]
