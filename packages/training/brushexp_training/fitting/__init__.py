"""Train networks: the Lightning modules, and the training code that they share."""
