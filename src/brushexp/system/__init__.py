"""What the machine gives: files, HDF5, checkpoints, the compiler, processes and threads."""
