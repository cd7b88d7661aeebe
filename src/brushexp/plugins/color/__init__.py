"""Colour spaces in which paint is composited. Pick one: ``color=rgb``."""
