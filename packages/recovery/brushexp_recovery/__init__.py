"""Strokes are recovered from a picture of a painting."""
