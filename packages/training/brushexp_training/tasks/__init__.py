"""The tasks of the package, one module each, and their keys."""
