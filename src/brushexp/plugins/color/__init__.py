"""Colour spaces in which paint is composited; choose one with ``color=rgb``."""
