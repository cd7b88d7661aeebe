"""Runs: their folders, the Trainer, resuming, sweeps and trackers."""
