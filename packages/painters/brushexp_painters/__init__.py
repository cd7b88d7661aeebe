"""Painters published by others, as baselines."""
