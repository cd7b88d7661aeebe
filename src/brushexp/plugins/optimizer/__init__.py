"""Optimisers move strokes, given their gradients; choose one with ``optimizer=adam``."""
