"""Media for looks such as ``look=watercolour``: papers, palettes, marks of brushes and chalk, dots and drawn lines."""
