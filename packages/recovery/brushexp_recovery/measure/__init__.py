"""Measure the brushwork of recovered strokes, and write the measures with intervals as tables, drawings and files."""
