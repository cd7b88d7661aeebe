"""Brush simulators, which are plugins of the ``engine`` family."""
