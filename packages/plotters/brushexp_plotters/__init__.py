"""Plans for pen plotters and painting robots, as members of the family ``to``."""

from brushexp_plotters import gcode, hpgl

__all__ = ["gcode", "hpgl"]
