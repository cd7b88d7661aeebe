"""Loggers: where the curves of a run go. Pick several: ``'logger=[csv]'``."""
