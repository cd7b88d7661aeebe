"""Compress a painting: round its strokes, encode them in a small file, and decode and paint that file."""
