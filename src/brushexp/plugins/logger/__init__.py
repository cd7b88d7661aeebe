"""Loggers record a run's curves, pictures and metrics; choose several with ``logger=csv,wandb``."""
