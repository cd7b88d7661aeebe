"""Media: papers, palettes, marks of brushes and chalk, dots and drawn lines, for ``look=watercolour`` and others."""
