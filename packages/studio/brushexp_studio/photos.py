"""Store uploaded pictures and samples; each picture is decoded once and kept as a plain PNG."""

import itertools
import logging
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import RLock, get_ident
from typing import Any

import numpy as np
from PIL import Image

from brushexp.contracts import UserError
from brushexp.contracts.files import write_picture
from brushexp.contracts.pages import encode
from brushexp.contracts.pictures import check_ratio, read_picture, samples

LARGEST_UPLOAD = 2**26  # bytes of a file from the browser
LONGEST_NAME = 60  # letters
LARGEST_SIDE = 2048  # pixels; no larger canvas can be chosen
JPEG: dict[str, Any] = {"format": "JPEG", "quality": 90}  # options of pictures on the page
SAMPLES = ("astronaut", "grace_hopper", "chelsea", "coffee", "rocket")  # shipped with scikit-image and Matplotlib
PAINTINGS = {  # samples of styles: key -> file; made with look=vangogh and look=gouache at 512 pixels
    "rocket_after_van_gogh": Path(__file__).parent / "paintings" / "rocket_after_van_gogh.webp",
    "coffee_in_gouache": Path(__file__).parent / "paintings" / "coffee_in_gouache.webp",
}


@dataclass(frozen=True)
class Photo:
    """A picture that is stored as a PNG in the session's folder."""

    key: str
    name: str  # name of the user's file or of a sample, or path of a painting
    path: Path
    size: tuple[int, int]  # height, width
    remark: str = ""  # warnings about the file, for example that it is cut short or may be damaged

    @property
    def ratio(self) -> float:
        return self.size[1] / self.size[0]

    @property
    def address(self) -> str:
        return f"/photos/{self.key}/shown.jpg"

    def jpeg(self, side: int) -> bytes:
        """Encode the picture as a JPEG for the page, with at most ``side`` pixels on its longer side."""
        with Image.open(self.path) as picture:
            return encode(picture.convert("RGB"), side, **JPEG)


class Photos:
    """The pictures and masks of a session, accessed by keys that are not file paths."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.masks: dict[str, Path] = {}  # masks by stem
        self._photos: dict[str, Photo] = {}
        self._numbers = itertools.count(1)
        self._reading = RLock()  # one picture at a time: pictures may be large, and remarks are read from stderr

    def __getitem__(self, key: str) -> Photo:
        """Return an uploaded picture by key, or a sample or painting by name; raise UserError if there is none."""
        with self._reading:
            if key in SAMPLES and key not in self._photos:
                self._photos[key] = self._store(samples()[key], key, key)
            if key in PAINTINGS and key not in self._photos:
                path = PAINTINGS[key]
                self._photos[key] = self._store(path, key, str(path))  # the painting's command names this path
        if key not in self._photos:
            raise UserError("this picture no longer exists; choose it again")
        return self._photos[key]

    def add(self, received: Path, name: str) -> Photo:
        """Read and store an uploaded file under its original name; raise UserError if it is not a valid picture."""
        key = f"photo{next(self._numbers)}"
        path = Path("".join(letter for letter in name if letter.isprintable()) or "picture")
        short = path.stem[:LONGEST_NAME] + path.suffix[:LONGEST_NAME] or "picture"
        try:
            self._photos[key] = self._store(received, key, short)
        except UserError as error:
            raise UserError(str(error).replace(f"picture={received}", short)) from error
        return self._photos[key]

    def add_mask(self, received: Path, photo: Photo) -> str | None:
        """Store an uploaded mask for a picture and return its key, or None if the mask is empty.

        Raises UserError if the mask's aspect ratio differs from that of the picture.
        """
        with self._reading:
            grey = read_picture(received, key="mask").max(2)
            check_ratio("the mask", grey.shape, photo.size, "focus")
            return self.keep_mask(grey)

    def keep_mask(self, grey: np.ndarray) -> str | None:
        """Store a mask (H, W) and return its key, or None if the mask is empty."""
        if not grey.any():
            return None
        path = self.folder / f"mask{next(self._numbers)}.png"
        write_picture(path, np.repeat(grey[..., None], 3, 2))
        self.masks[path.stem] = path
        return path.stem

    def _store(self, path: Path, key: str, name: str) -> Photo:
        with self._reading, remarks() as told:
            pixels = read_picture(path, key="picture")
            if pixels.dtype != np.uint8:
                pixels = np.rint(pixels * 255).astype(np.uint8)
            picture = Image.fromarray(pixels)
            picture.thumbnail((LARGEST_SIDE, LARGEST_SIDE), Image.Resampling.LANCZOS)
            del pixels
        file = self.folder / key / f"{portable_name(Path(name).stem)}.png"  # the page of the painting shows its name
        file.parent.mkdir(exist_ok=True)
        write_picture(file, np.asarray(picture))
        remark = " ".join(told).replace(f"picture={path}", name)
        return Photo(key, name, file, (picture.height, picture.width), remark)


@contextmanager
def remarks() -> Iterator[list[str]]:
    """Collect the warnings logged in this thread within the ``with`` block, for example about a truncated file."""
    told: list[str] = []
    thread = get_ident()

    class Listener(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if record.thread == thread:
                told.append(record.getMessage())

    listener, root = Listener(logging.WARNING), logging.getLogger("brushexp")
    root.addHandler(listener)
    try:
        yield told
    finally:
        root.removeHandler(listener)


def portable_name(name: str) -> str:
    """Convert a name to a file name that is valid on every system."""
    return re.sub(r"[^\w-]+", "_", name)
