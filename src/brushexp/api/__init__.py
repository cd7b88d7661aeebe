"""Expose the tasks of the command line as Python functions: ``import brushexp``."""
