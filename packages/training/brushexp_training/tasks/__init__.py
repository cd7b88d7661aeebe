"""The tasks of this package, one module per task."""
