"""GIF, WebP, PNG and AVIF files whose pictures follow one another are films, too."""

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import numpy as np

from brushexp.pictures.decode import MOVING, decode_image
from brushexp.pictures.limits import open_of_any_size

SUFFIXES = (".gif", ".webp", ".png", ".apng", ".avif", ".avifs")
SHORTEST, INSTEAD = 10, 100  # milliseconds: up to so few of a picture mean as many as this, in all browsers

Timed = tuple[np.ndarray, Fraction, Fraction]  # a picture (H, W, 3), its second, and how long it stays


def is_moving(path: str | Path) -> bool:
    """Test whether a file holds several pictures, one after the other in time."""
    if Path(path).suffix.lower() not in SUFFIXES or not Path(path).is_file():
        return False
    try:
        with open_of_any_size(path, MOVING) as file:
            return bool(getattr(file, "is_animated", False))
    except Exception:  # what is damaged is told by what reads it as a picture
        return False


def moving_pictures(path: Path) -> Iterator[Timed]:
    """Decode the pictures as `read_picture` does, with their times; decoders may raise anything."""
    time = Fraction(0)
    with open_of_any_size(path, MOVING) as file:
        is_apart = "default_image" in file.info and file.info["default_image"]  # of a PNG: for those that show no film
        for number in range(int(bool(is_apart)), getattr(file, "n_frames", 1)):
            file.seek(number)
            picture = decode_image(file)
            stays = float(file.info.get("duration", 0) or 0)
            length = Fraction(INSTEAD if stays <= SHORTEST else stays).limit_denominator(1000) / 1000
            yield picture, time, length
            time += length
