"""Loggers: destinations of the curves, pictures and numbers of a run. Choose any number: ``logger=csv,wandb``."""
