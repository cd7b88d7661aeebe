"""What the program does: one module for each task, whose keys are in config/schema.py. Pick one: ``task=paint``."""
