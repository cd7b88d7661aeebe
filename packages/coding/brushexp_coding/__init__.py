"""Compress paintings: round strokes, encode them in a small file, and decode and paint such files."""
