"""Find and count the faces in a photograph, and mark them in a mask."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from PIL import Image, ImageDraw

from brushexp.contracts.painting import faces_of
from brushexp.contracts.runs import settings_of
from brushexp_studio.photos import Photo

REACH = 0.7  # sides of a face: radius of its mark


@lru_cache(maxsize=64)
def find_faces(photo: Photo) -> list[Any]:
    """Find faces with the detector used in painting; each has a centre ``x``, ``y`` and a ``side``, in photo pixels."""
    with Image.open(photo.path) as picture:
        pixels = np.asarray(picture.convert("RGB"), np.float32) / 255
    return faces_of(settings_of("paint", {"faces": "auto"}).cfg, torch.from_numpy(pixels).movedim(2, 0))


def in_words(count: int) -> str:
    """State the number of faces that were found.

    >>> in_words(0), in_words(1), in_words(5)
    ('Found no face.', 'Found 1 face.', 'Found 5 faces.')
    """
    return f"Found {count or 'no'} face{'s' if count > 1 else ''}."


def mask_of(faces: Sequence[Any], size: tuple[int, int]) -> np.ndarray:
    """Draw a uint8 mask of ``size`` (H, W) with a disc on each face."""
    mask = Image.new("L", (size[1], size[0]))
    for face in faces:
        radius = REACH * face.side
        box = (face.x - radius, face.y - radius, face.x + radius, face.y + radius)
        ImageDraw.Draw(mask).ellipse(box, fill=255)
    return np.asarray(mask)
