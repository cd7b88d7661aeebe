"""Directions of strokes that are drawn by hand: ``guides=lines.png``."""
