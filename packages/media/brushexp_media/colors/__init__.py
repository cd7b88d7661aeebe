"""Colour spaces other than RGB in which paint is composited, as members of the family ``color``."""
