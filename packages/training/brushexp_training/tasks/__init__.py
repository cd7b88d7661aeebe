"""The tasks of this package, with one module for each."""
