"""Measure the brushwork in catalogues as art historians do, and summarise it in tables and figures."""
