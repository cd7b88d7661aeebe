"""Strokes at a glance: a network that sees a picture a few times and lays its strokes, without a gradient step."""
