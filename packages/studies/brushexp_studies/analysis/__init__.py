"""Measure the brushwork in catalogues as art historians do: strokes -> measures -> summary -> tables and figures."""
