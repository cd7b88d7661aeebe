"""Expose the command-line tasks as Python functions: ``import brushexp``."""
