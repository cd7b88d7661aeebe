"""What the program can do: one module for each, whose keys are in app/schema.py. Pick one: ``task=paint``."""
