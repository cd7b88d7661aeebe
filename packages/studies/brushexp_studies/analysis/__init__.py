"""Measure the brushwork of catalogues as art historians do: strokes -> measures -> summary -> tables and figures."""
