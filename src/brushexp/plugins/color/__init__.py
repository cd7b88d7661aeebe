"""Colour spaces in which paint is laid over paint. Pick one: ``color=rgb``."""
