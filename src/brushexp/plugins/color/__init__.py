"""Colour spaces are where paint is composited; choose one with ``color=rgb``."""
