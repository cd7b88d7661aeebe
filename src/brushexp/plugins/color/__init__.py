"""Colour spaces in which paint is composited. Choose one: ``color=rgb``."""
