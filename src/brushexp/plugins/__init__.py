"""Shipped plugins, with one folder per family: ``base.py`` is the contract, and every other file a plugin."""
