"""Compress paintings: round strokes and encode them in a small file, and decode and paint such files."""
