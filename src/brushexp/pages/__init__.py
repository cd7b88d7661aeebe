"""HTML pages for runs and sweeps, each a single self-contained file that does not load anything from a network."""
