"""Shipped plugins: one folder per family, in which ``base.py`` is the contract and every other file a plugin."""
