"""Callbacks that come with Lightning, as members of the family ``callbacks``."""
