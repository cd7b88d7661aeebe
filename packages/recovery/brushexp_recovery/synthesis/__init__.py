"""Synthesise paintings with known strokes, given a seed and pictures as subjects."""
