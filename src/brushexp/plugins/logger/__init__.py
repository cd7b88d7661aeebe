"""Loggers: where the curves, pictures and numbers of a run go. Pick several: ``logger=csv,wandb``."""
