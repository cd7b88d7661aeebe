"""Repaint one region of a painting: ``region=mask.png``."""
