"""Compress a painting: round its strokes, code them as a small file, and read and paint that file again."""
