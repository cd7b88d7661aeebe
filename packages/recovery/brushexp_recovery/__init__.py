"""Strokes are recovered from a picture of a painting, measured, and judged by truth."""
