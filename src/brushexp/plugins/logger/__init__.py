"""Loggers record the curves, pictures and numbers of a run; choose several with ``logger=csv,wandb``."""
