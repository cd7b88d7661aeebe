"""Carry out runs: manage folders, the Trainer, resuming, sweeps and trackers."""
