"""Recovered strokes go in; figures of the brushwork with intervals, and their tables, drawings and files, come out."""
