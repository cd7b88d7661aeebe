"""HTML pages of runs and sweeps, each a single self-contained file that loads nothing from a network."""
