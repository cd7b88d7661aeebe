"""Initialisers of media: how a draughtsman, a pastellist or a pointillist lays the first strokes."""
