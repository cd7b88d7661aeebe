"""Optimisers: how the strokes move. Pick one: ``optimizer=adam``."""
