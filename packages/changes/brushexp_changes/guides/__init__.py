"""Strokes follow lines that are drawn by hand: ``guides=lines.png``."""
