"""The size of a photograph, which must be large enough to tell strokes apart."""

from brushexp.contracts import UserError
from brushexp.contracts.pictures import size_of_picture

SHORTEST_SIDE = 48  # pixels


def size_of_photograph(path: str, key: str = "image") -> tuple[int, int]:
    """Return height and width of a photograph; a UserError if no strokes can be told apart in so few pixels."""
    height, width = size_of_picture(path, key)
    if min(height, width) < SHORTEST_SIDE:
        raise UserError(
            f"{key}={path} has {width} x {height} pixels, too few to tell strokes apart; give a photograph of "
            f"{SHORTEST_SIDE} pixels or more on each side, in which strokes are 6 pixels wide or wider"
        )
    return height, width
