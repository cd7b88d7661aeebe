"""Optimisers move strokes along their gradients; choose one with ``optimizer=adam``."""
