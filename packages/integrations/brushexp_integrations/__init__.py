"""Other programs: trackers of runs, callbacks of Lightning, clusters and searches."""
