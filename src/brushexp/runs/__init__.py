"""Runs: their folders, the Trainer, resuming, sweeps, trackers."""
