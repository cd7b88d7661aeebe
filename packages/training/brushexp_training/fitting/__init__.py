"""Train networks: Lightning modules and the fitting that they share."""
