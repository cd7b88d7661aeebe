"""Carry out tasks: one module for each, whose keys are in config/schema.py. Pick one: ``task=paint``."""
