"""Trained renderers made smaller: ``task=prune``."""
