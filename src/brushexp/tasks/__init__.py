"""Tasks are the program's commands, one per module, with keys in config/schema.py; choose one with ``task=paint``."""
