"""Offer the tasks of the command line as functions of Python: ``import brushexp``."""
