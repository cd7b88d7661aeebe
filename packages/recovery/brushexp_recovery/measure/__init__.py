"""Measure the brushwork of recovered strokes: figures with intervals, tables, drawings and files."""
