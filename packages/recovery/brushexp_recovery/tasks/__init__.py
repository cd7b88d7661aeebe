"""The command-line tasks of this package, one module each, and their keys."""
