"""Published painting methods, used as baselines."""
