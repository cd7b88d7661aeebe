"""Runs: their folders, the Trainer, resumed runs, sweeps, trackers."""
