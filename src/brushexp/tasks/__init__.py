"""The program's commands, called tasks: one per module, chosen with ``task=paint``; config/schema.py lists the keys."""
