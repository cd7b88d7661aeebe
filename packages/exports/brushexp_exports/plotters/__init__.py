"""Plans for pen plotters and painting robots."""
