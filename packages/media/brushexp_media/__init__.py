"""Media for looks such as ``look=watercolour``: papers, palettes, brush and chalk marks, dots and drawn lines."""
