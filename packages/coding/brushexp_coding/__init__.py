"""Bits of a painting: strokes are rounded and coded as a file, which is read and painted again."""
