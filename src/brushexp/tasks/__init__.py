"""Perform tasks: one module per task, with keys in config/schema.py. Choose one: ``task=paint``."""
