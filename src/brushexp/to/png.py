"""The painting as a picture of any size."""

from pathlib import Path

import numpy as np

from brushexp.files import to_bytes, write_picture
from brushexp.registry import register
from brushexp.to.base import Exporter, Work


@register("to", "png")
class Png(Exporter):
    """``painting.png``: the picture, crisp at any ``resolution``: the strokes are scaled, not the pixels."""

    def __init__(self) -> None: ...

    def write(self, work: Work, folder: Path) -> list[Path]:
        path = folder / "painting.png"
        write_picture(path, pixels(work))
        return [path]


def pixels(work: Work) -> np.ndarray:
    """The picture (H, W, 3) in 8 bits, painted in bands, so that it takes little more memory than its pixels."""
    picture = np.empty((*work.size, 3), dtype=np.uint8)
    for top, band in work.bands():
        picture[top : top + band.shape[1]] = to_bytes(band)
    return picture
