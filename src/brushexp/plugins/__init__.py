"""Shipped plugins, one folder per family: ``base.py`` defines the base class, and every other file is a plugin."""
