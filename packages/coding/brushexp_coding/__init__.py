"""Compress paintings into small files of rounded, encoded strokes, and decode and paint such files."""
