"""Strokes at a glance: a network that sees a picture a few times and lays its strokes, without a gradient step."""

from brushexp_predictor import predicted, predictor

__all__ = ["predicted", "predictor"]
