"""Losses beyond the textbook ones, and the networks behind LPIPS."""
