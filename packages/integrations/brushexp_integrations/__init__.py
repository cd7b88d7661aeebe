"""Connect runs to experiment trackers, Lightning callbacks, clusters and hyperparameter searches."""
