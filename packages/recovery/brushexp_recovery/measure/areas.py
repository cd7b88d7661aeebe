"""Define the areas of a photograph in which strokes are measured."""

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp.contracts import UserError
from brushexp.contracts.pictures import load_picture
from brushexp_recovery.measure.scale import SIDES_APART

Array = NDArray[Any]

WHOLE = "whole"  # name of the whole photograph
BRIGHT = 0.5  # minimum brightness of a mask's pixel in the area


def areas_of(texts: list[str] | None, size: tuple[int, int]) -> dict[str, Array]:
    """Make masks (H, W) of areas of a photograph, keyed by name: the ``whole`` photograph and each of ``texts``.

    A text is either a rectangle, left,top,width,height in pixels, or the path of a mask picture that is bright in the
    area.
    """
    areas = {WHOLE: np.ones(size, bool)}
    for text in texts or []:
        areas[text] = _rectangle(text, size) if re.fullmatch(r"[\d., -]+", text) else _mask(text, size)
        if not areas[text].any():
            raise UserError(
                f"region={text} has no pixel of the photograph, {size[1]} x {size[0]}; choose another region"
            )
    return areas


def _rectangle(text: str, size: tuple[int, int]) -> Array:
    try:
        left, top, width, height = (round(float(number)) for number in text.split(","))
    except ValueError:
        raise UserError(f"region={text} is not a rectangle; try 'region=[\"0,0,{size[1] // 2},{size[0]}\"]'") from None
    mask = np.zeros(size, bool)
    mask[max(top, 0) : max(top + height, 0), max(left, 0) : max(left + width, 0)] = True
    return mask


def _mask(text: str, size: tuple[int, int]) -> Array:
    from skimage.transform import resize  # noqa: PLC0415  (slow to import)

    picture = load_picture(text, None, "region").mean(0).numpy()
    shape, wanted = picture.shape[1] / picture.shape[0], size[1] / size[0]
    if abs(shape / wanted - 1) > SIDES_APART:
        raise UserError(f"region={Path(text)} does not have the shape of the photograph; draw the mask on a copy of it")
    return np.asarray(resize(picture, size, order=0) >= BRIGHT)
