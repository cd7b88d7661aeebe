"""Millimetres of a painting in its photograph, and the parts of it that are measured."""

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp.errors import UserError
from brushexp.pictures.load import load_picture

Array = NDArray[Any]

SIDES_APART = 0.03  # by which width and height may give different scales, as a share
BRIGHT = 0.5  # from which on a pixel of a mask belongs to the region


def scale_of(size: tuple[int, int], width_cm: float | None, size_cm: str | None, prefix: str = "") -> float | None:
    """Compute millimetres per pixel of a photograph (H, W); None if no size of the painting is given.

    ``width_cm`` is that of the painting from edge to edge of the photograph, ``size_cm`` its width and height, 92x73.
    UserError if both are given, or if they do not have the shape of the photograph. Keys begin with ``prefix``.
    """
    if width_cm is not None and size_cm is not None:
        raise UserError(f"{prefix}width_cm and {prefix}size_cm say the same; give one of them")
    if size_cm is None:
        return None if width_cm is None else 10 * width_cm / size[1]
    if not re.fullmatch(r"\d+(\.\d+)?x\d+(\.\d+)?", size_cm):
        raise UserError(f"{prefix}size_cm={size_cm} is no width and height; try {prefix}size_cm=92x73")
    width, height = (10 * float(side) for side in size_cm.split("x"))
    if min(width, height) <= 0:
        raise UserError(f"{prefix}size_cm={size_cm} has no area; try {prefix}size_cm=92x73")
    across, down = width / size[1], height / size[0]
    if abs(across / down - 1) > SIDES_APART:
        raise UserError(
            f"{prefix}size_cm={size_cm} has not the shape of the photograph, {size[1]} x {size[0]} pixels: cut it to "
            f"the painting's edges, or give {prefix}width_cm=... of what it shows"
        )
    return 0.5 * (across + down)


def regions_of(texts: list[str] | None, size: tuple[int, int]) -> dict[str, Array]:
    """Make masks (H, W) of the parts of a photograph by name: the ``whole``, and each of ``texts``.

    A text is a rectangle, left,top,width,height in pixels, or a picture that is bright where the region is.
    """
    regions = {"whole": np.ones(size, bool)}
    for text in texts or []:
        regions[text] = _rectangle(text, size) if re.fullmatch(r"[\d., -]+", text) else _mask(text, size)
        if not regions[text].any():
            raise UserError(f"region={text} has no pixel of the photograph, {size[1]} x {size[0]}; give another one")
    return regions


def _rectangle(text: str, size: tuple[int, int]) -> Array:
    try:
        left, top, width, height = (round(float(number)) for number in text.split(","))
    except ValueError:
        raise UserError(f"region={text} is no rectangle; try 'region=[\"0,0,{size[1] // 2},{size[0]}\"]'") from None
    mask = np.zeros(size, bool)
    mask[max(top, 0) : max(top + height, 0), max(left, 0) : max(left + width, 0)] = True
    return mask


def _mask(text: str, size: tuple[int, int]) -> Array:
    from skimage.transform import resize  # noqa: PLC0415  (slow to import)

    picture = load_picture(text, None, "region").mean(0).numpy()
    shape, wanted = picture.shape[1] / picture.shape[0], size[1] / size[0]
    if abs(shape / wanted - 1) > SIDES_APART:
        raise UserError(f"region={Path(text)} has not the shape of the photograph; draw the mask on a copy of it")
    return np.asarray(resize(picture, size, order=0) >= BRIGHT)
