"""Optimisers: how strokes move. Choose one: ``optimizer=adam``."""
