"""Connect runs to other programs: experiment trackers, Lightning's callbacks, clusters and hyperparameter searches."""
