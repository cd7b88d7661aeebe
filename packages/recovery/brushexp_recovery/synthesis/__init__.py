"""Synthesise paintings with known strokes from a seed and a subject."""
