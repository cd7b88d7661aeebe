"""The painting as an object under a light, and its shape for printers and 3D programs."""

import io
import logging
import math
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from brushexp.bounds import between
from brushexp.errors import UserError
from brushexp.plugins.export.base import Exporter, ExportJob
from brushexp.registry import register
from brushexp.shading.height import height_of
from brushexp.shading.light import Light, normals_of, shaded
from brushexp.system.files import to_bytes, write_bytes, write_picture

log = logging.getLogger(__name__)
PIXELS = 2**20  # that are lit at once
WHITE = 2**16 - 1


@register("to", "relief")
class Relief(Exporter):
    """``relief.png``: thick paint under a light, ``light=315,45``; ``height.png`` and ``normals.png`` are its shape.

    ``height.png`` has 16 bits: black is the bare canvas, white the highest point; how high that is stands in the log
    and in the texts of the file, ``Description`` and ``HeightOfWhite`` (pixels). ``normals.png`` is a tangent-space
    normal map in the convention of OpenGL: red to the right, green up, blue to the viewer, -1 to 1 as 0 to 255.

    Args:
        light: azimuth in degrees clockwise from the top (315: upper left), and elevation above the canvas.
        depth: how thick the paint is, in all three files; 1 is natural, 0 flat.
        gloss: of the paint, 0 (matt) to 1 (wet).
    """

    def __init__(
        self,
        *,
        light: list[float] = [315.0, 45.0],  # noqa: B006
        depth: Annotated[float, between(0, 1000)] = 1.0,
        gloss: Annotated[float, between(0, 1)] = 0.25,
    ) -> None:
        typed = ",".join(f"{value:g}" for value in light)
        if len(light) != 2:
            raise UserError(f"light={typed} is not an azimuth and an elevation in degrees; try light=315,45")
        if not math.isfinite(light[0]):
            raise UserError(f"light={typed}: the azimuth is not a number of degrees; try light=315,45")
        if not 0 < light[1] <= 90:
            raise UserError(
                f"light={typed}: an elevation of {light[1]:g} is not above 0 and up to 90 degrees; "
                f"try light={light[0]:g},45"
            )
        self.light = Light(*light)
        self.depth = depth
        self.gloss = gloss

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        height = height_of(job)
        names = ("relief.png", "height.png", "normals.png")
        relief, heights, normals = (folder / name for name in names)
        write_picture(relief, self.lit(job, height))  # one after the other: large pictures are large in memory
        white = self.depth * float(height.max())
        log.info("%s: white is %s", heights, height_of_white(white, job.size))
        write_bytes(heights, encoded(levels_of(height), white, job.size))
        write_picture(normals, normal_map(height, self.depth))
        return [relief, heights, normals]

    def lit(self, job: ExportJob, height: np.ndarray) -> np.ndarray:
        """The painting under the light (H, W, 3), 8 bits, from its heights (H, W)."""
        picture = np.empty((*job.size, 3), np.uint8)
        for top, band in job.bands():
            bottom = top + band.shape[1]
            normals = normals_of(height, self.depth, top, bottom)
            lit = shaded(band.float().cpu().numpy(), normals, self.light, self.gloss)
            picture[top:bottom] = to_bytes(torch.from_numpy(lit))
        return picture


def normal_map(height: np.ndarray, depth: float) -> np.ndarray:
    """Normals of heights (H, W) as colours (H, W, 3), 8 bits."""
    picture = np.empty((*height.shape, 3), np.uint8)
    rows = max(1, PIXELS // height.shape[1])
    for top in range(0, len(height), rows):
        normals = normals_of(height, depth, top, top + rows)
        picture[top : top + rows] = to_bytes(torch.from_numpy(0.5 * normals + 0.5))
    return picture


def levels_of(height: np.ndarray) -> np.ndarray:
    """Heights (H, W) in 16 bits, the highest one white."""
    levels = np.empty(height.shape, np.uint16)
    highest = float(height.max())
    per_pixel = WHITE / highest if highest > 1e-6 else 0.0  # what is lower is rounding
    rows = max(1, PIXELS // height.shape[1])
    for top in range(0, len(height), rows):
        levels[top : top + rows] = np.rint(height[top : top + rows].clip(0) * per_pixel).clip(0, WHITE)
    return levels


def height_of_white(white: float, size: tuple[int, int]) -> str:
    """How high ``white`` pixels are, in words."""
    share = 100 * white / max(size)
    return f"{white:.6g} pixels above the bare canvas, {share:.4g} % of the longer side ({size[1]} x {size[0]} pixels)"


def encoded(levels: np.ndarray, white: float, size: tuple[int, int]) -> bytes:
    """A PNG of levels (H, W) in 16 bits, with their scale in its texts."""
    texts = PngInfo()
    texts.add_text(
        "Description", f"height of the paint: 0 is the bare canvas, {WHITE} is {height_of_white(white, size)}"
    )
    texts.add_text("HeightOfWhite", f"{white:.9g}")
    file = io.BytesIO()
    Image.fromarray(levels).save(file, format="PNG", pnginfo=texts)
    return file.getvalue()
