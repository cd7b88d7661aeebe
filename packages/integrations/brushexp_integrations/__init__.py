"""Connect runs to experiment trackers, Lightning's callbacks, clusters and hyperparameter searches."""
