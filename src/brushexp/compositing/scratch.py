"""Define a worker's scratch memory, with rows for the 64 pixels of a tile, and copy picture tiles to and from it."""
# mypy: allow-untyped-defs

from brushexp.compat.compiled import inline
from brushexp.compositing.tile_lists import AREA, TILE, F


def channel_rows(channels: int) -> dict[str, int]:
    """Assign the rows of a worker's scratch memory for colours with ``channels`` channels.

    The first rows hold the picture painted so far or, in the backward pass, the colour behind the current stroke. The
    next rows hold the remaining light, the input picture (target, gradient or error), and the weight of its pixels or,
    for `pull`, the derivative with respect to alpha.
    """
    light, picture, weight = channels, channels + 1, 2 * channels + 1
    rows = {"LIGHT": light, "PICTURE": picture, "WEIGHT": weight, "PULL_ALPHA": weight}
    return {"CHANNELS": channels, **rows, "SCRATCH": weight + 1}


BEHIND = 0
CHANNELS, LIGHT, PICTURE, WEIGHT, PULL_ALPHA, SCRATCH = channel_rows(3).values()


@inline
def load_tile(picture, top, left, buf):
    """Copy a tile of a picture into rows PICTURE, and the weights of its pixels into row WEIGHT.

    The weights are the plane that follows the channels, or 1 if there is no such plane. Beyond the edge of the picture
    they are 0.
    """
    height, width = picture.shape[1] - top, picture.shape[2] - left
    if height >= TILE and width >= TILE:
        _read(picture, top, left, TILE, TILE, buf)
    else:
        buf[PICTURE * AREA : (WEIGHT + 1) * AREA] = F(0)
        _read(picture, top, left, min(TILE, height), min(TILE, width), buf)


@inline
def _read(picture, top, left, height, width, buf):
    """Copy part of a picture and its weights into the rows that start at PICTURE."""
    for c in range(CHANNELS):
        for y in range(height):
            _copy(picture[c, top + y, left:], buf[(PICTURE + c) * AREA + y * TILE :], width)
    for y in range(height):
        row = buf[WEIGHT * AREA + y * TILE :]
        if len(picture) > CHANNELS:
            _copy(picture[CHANNELS, top + y, left:], row, width)
        else:
            row[:width] = F(1)


@inline
def _copy(source, goal, n):
    for x in range(n):
        goal[x] = source[x]


@inline
def show(buf, background, top, left, image):
    """Write a finished tile to the picture, adding the bare canvas where light is still transmitted."""
    for c in range(CHANNELS):
        for q in range(AREA):
            buf[c * AREA + q] += buf[LIGHT * AREA + q] * background[c]
    height, width = image.shape[1] - top, image.shape[2] - left
    if height >= TILE and width >= TILE:
        _write(buf, top, left, TILE, TILE, image)
    else:
        _write(buf, top, left, min(TILE, height), min(TILE, width), image)


@inline
def _write(buf, top, left, height, width, image):
    """Copy a tile's colours to the picture, for the part of the tile that is inside it."""
    for c in range(CHANNELS):
        for y in range(height):
            _copy(buf[c * AREA + y * TILE :], image[c, top + y, left:], width)
