"""Carry out tasks: one module per task, with keys in config/schema.py. Pick one: ``task=paint``."""
