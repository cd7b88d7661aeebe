"""Published painters, as baselines."""
