"""Define the channels of the network's maps, and the stroke attributes that some channels contain."""

from enum import IntEnum

from brushexp_recovery.raster.offsets import Offset

DISTANCES = (3, 8, 20)  # lengths in pixels of the offsets beyond adjacent pixels
AFFINITY_OFFSETS: tuple[Offset, ...] = (
    (0, 1),
    (1, 0),
    *(offset for d in DISTANCES for offset in ((0, d), (d, 0), (d, d), (d, -d))),
)
OCCLUSION_OFFSETS = AFFINITY_OFFSETS[2:10]  # offsets of 3 and 8 pixels
CENTRE_UNIT = 32.0  # unit in pixels of the offset from a pixel to the centre of its stroke


class StrokeAttribute(IntEnum):
    """Predicted attributes of a stroke, as channels of maps and columns of tables."""

    CENTRE_X = 0  # offset from the pixel in units of `CENTRE_UNIT` in maps, place in pixels in tables
    CENTRE_Y = 1
    COSINE = 2  # cosine of twice the direction
    SINE = 3
    LOG_WIDTH = 4  # logarithm of pixels
    LOG_LENGTH = 5
    VISIBLE = 6  # share of the stroke that is visible; the network predicts its log-odds


CENTRE = slice(StrokeAttribute.CENTRE_X, StrokeAttribute.CENTRE_Y + 1)
DIRECTION = slice(StrokeAttribute.COSINE, StrokeAttribute.SINE + 1)
LOG_SIZE = slice(StrokeAttribute.LOG_WIDTH, StrokeAttribute.LOG_LENGTH + 1)

PAINT = len(AFFINITY_OFFSETS)
AFFINITY = slice(0, PAINT)
ATTRIBUTES = slice(PAINT + 1, PAINT + 1 + len(StrokeAttribute))
OCCLUSION = slice(ATTRIBUTES.stop, ATTRIBUTES.stop + len(OCCLUSION_OFFSETS))
CHANNELS = OCCLUSION.stop
