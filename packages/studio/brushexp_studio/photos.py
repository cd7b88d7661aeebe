"""Pictures that the visitor brings, and samples: read once by our own readers, and kept as plain files of ours."""

import itertools
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from threading import RLock
from typing import Any

import numpy as np
from PIL import Image

from brushexp.errors import UserError
from brushexp.pages.html import encode
from brushexp.pictures.decode import read_picture
from brushexp.pictures.load import check_ratio, samples
from brushexp.system.files import write_picture

LARGEST_UPLOAD = 2**26  # bytes of a file from the browser
LONGEST_NAME = 60  # letters
KEPT_SIDE = 2048  # pixels of the longer side: nothing larger is painted here
JPEG: dict[str, Any] = {"format": "JPEG", "quality": 90}  # of what the page shows
SHOWN_SIDE, THUMB_SIDE = 1280, 240  # pixels, of what the page shows
SAMPLES = ("astronaut", "chelsea", "coffee", "rocket", "motorcycle_left", "hubble_deep_field", "retina")  # skimage's


@dataclass(frozen=True)
class Photo:
    """A picture as a PNG in the session's folder."""

    key: str
    name: str  # of the visitor's file, or of a sample
    path: Path
    size: tuple[int, int]  # height, width

    @property
    def ratio(self) -> float:
        return self.size[1] / self.size[0]

    @cached_property
    def shown(self) -> bytes:
        """A JPEG for the page."""
        return self._jpeg(SHOWN_SIDE)

    @cached_property
    def thumb(self) -> bytes:
        """A small JPEG."""
        return self._jpeg(THUMB_SIDE)

    def _jpeg(self, side: int) -> bytes:
        with Image.open(self.path) as picture:
            return encode(picture.convert("RGB"), side, **JPEG)


class Photos:
    """The pictures and masks of a session, by keys that are no paths."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.masks: dict[str, Path] = {}  # by their stems
        self._photos: dict[str, Photo] = {}
        self._numbers = itertools.count(1)
        self._reading = RLock()  # one at a time: they may be large, and stderr, from which remarks are kept, is one

    def __getitem__(self, key: str) -> Photo:
        """A picture by its key; samples have their names. UserError if there is none."""
        with self._reading:
            if key in SAMPLES and key not in self._photos:
                self._photos[key] = self._kept(samples()[key], key, key)
        if key not in self._photos:
            raise UserError("this picture is no longer there; choose it again")
        return self._photos[key]

    def add(self, received: Path, name: str) -> Photo:
        """Read a file that the browser has sent, under the name that it has there; UserError if it is no picture."""
        key = f"photo{next(self._numbers)}"
        path = Path("".join(letter for letter in name if letter.isprintable()) or "picture")
        shown = path.stem[:LONGEST_NAME] + path.suffix[:LONGEST_NAME] or "picture"
        try:
            self._photos[key] = self._kept(received, key, shown)
        except UserError as error:
            raise UserError(str(error).replace(f"picture={received}", shown)) from error
        return self._photos[key]

    def add_mask(self, received: Path, photo: Photo) -> str | None:
        """Keep a mask for a picture; its key, or None if nothing is painted on it. UserError if it does not fit."""
        path = self.folder / f"mask{next(self._numbers)}.png"
        with self._reading:
            grey = read_picture(received, key="mask").max(2)
            check_ratio("the mask", grey.shape, photo.size, "focus")
            if not grey.any():
                return None
            write_picture(path, np.repeat(grey[..., None], 3, 2))
        self.masks[path.stem] = path
        return path.stem

    def _kept(self, path: Path, key: str, name: str) -> Photo:
        with self._reading:
            pixels = read_picture(path, key="picture")
            if pixels.dtype != np.uint8:
                pixels = np.rint(pixels * 255).astype(np.uint8)
            picture = Image.fromarray(pixels)
            picture.thumbnail((KEPT_SIDE, KEPT_SIDE), Image.Resampling.LANCZOS)
            del pixels
        kept = self.folder / key / f"{in_plain_letters(Path(name).stem)}.png"  # its name is that of the painting's page
        kept.parent.mkdir(exist_ok=True)
        write_picture(kept, np.asarray(picture))
        return Photo(key, name, kept, (picture.height, picture.width))


def in_plain_letters(name: str) -> str:
    """A name for a file that any system takes."""
    return re.sub(r"[^\w-]+", "_", name)
