"""Use the machine: files, HDF5, checkpoints, processes and threads."""
