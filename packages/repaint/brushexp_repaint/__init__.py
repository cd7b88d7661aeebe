"""Repaint one region of a painting: ``region=mask.png``, and all else stays to the bit."""
