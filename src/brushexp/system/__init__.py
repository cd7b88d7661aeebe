"""Manage files, HDF5, checkpoints, processes, threads, memory and terminals."""
