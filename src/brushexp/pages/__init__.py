"""HTML pages for runs and sweeps. Each page is one self-contained file that loads nothing from the network."""
