"""Brushwork as art historians measure it, of catalogues: strokes -> measures -> summary -> tables, figures."""
