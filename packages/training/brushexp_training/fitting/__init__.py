"""Train networks: Lightning modules, and the fit that they share."""
