"""Renderers that are networks, and their pruning."""
