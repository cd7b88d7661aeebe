"""Changes of a painting: guides, one region, tubes and brushes of a table, sizes of strokes, wet paint, grounds.

Several may be chosen: ``guides=lines.png tubes=zorn``.
"""

from brushexp_changes import random_ground, sizes
from brushexp_changes.guides import guides
from brushexp_changes.region import region
from brushexp_changes.tubes import difference, gamut, sheets, tubes
from brushexp_changes.wet import wet

__all__ = ["difference", "gamut", "guides", "random_ground", "region", "sheets", "sizes", "tubes", "wet"]
