"""Check that a photograph is large enough to distinguish strokes, and small enough to process."""

from brushexp.contracts import UserError
from brushexp.contracts.pictures import sides_of_picture

SHORTEST_SIDE = 48  # pixels
MOST_PIXELS = 100_000_000  # because the photograph is read in full


def size_of_photograph(path: str, key: str = "image") -> tuple[int, int]:
    """Return the height and width of a photograph; raise a UserError if it has too few or too many pixels.

    The upper limit is needed because the photograph is read at full size. The error does not suggest ``resolution=``,
    because the tasks of this package do not have this key.
    """
    height, width = sides_of_picture(path, key)
    if height * width > MOST_PIXELS:
        share = (MOST_PIXELS / (height * width)) ** 0.5
        raise UserError(
            f"{key}={path} has {width} x {height} pixels, but strokes are found in at most {MOST_PIXELS // 10**6} "
            f"megapixels; save it at {int(share * width)} x {int(share * height)} pixels or fewer, or cut it into "
            "parts"
        )
    if min(height, width) < SHORTEST_SIDE:
        raise UserError(
            f"{key}={path} has {width} x {height} pixels, too few to tell strokes apart; give a photograph of "
            f"{SHORTEST_SIDE} pixels or more on each side, in which strokes are at least 6 pixels wide"
        )
    return height, width
