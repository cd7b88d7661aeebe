"""The painting as an object under a light, and its shape for printers and 3D programs."""

import logging
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
from brushexp.system.files import replacing, to_bytes, write_picture

log = logging.getLogger(__name__)
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
        if len(light) != 2 or not 0 < light[1] <= 90:
            typed = ",".join(f"{value:g}" for value in light)
            wrong = f"light={typed} is not an azimuth and an elevation, which is above 0 and up to 90, in degrees"
            raise UserError(f"{wrong}; try light=315,45")
        self.light = Light(*light)
        self.depth = depth
        self.gloss = gloss

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        height = height_of(job)
        relief, normals = np.empty((*job.size, 3), np.uint8), np.empty((*job.size, 3), np.uint8)
        for top, band in job.bands():
            rows = slice(top, top + band.shape[1])
            facing = normals_of(height, self.depth, rows)
            normals[rows] = to_bytes(torch.from_numpy(0.5 * facing + 0.5))
            lit = shaded(band.float().cpu().numpy(), facing, self.light, self.gloss)
            relief[rows] = to_bytes(torch.from_numpy(lit))
        paths = [folder / name for name in ("relief.png", "height.png", "normals.png")]
        write_picture(paths[0], relief)
        write_picture(paths[2], normals)
        white = self.depth * float(height.max())
        share = 100 * white / max(job.size)
        told = f"{white:.6g} pixels above the bare canvas, {share:.4g} % of the longer side"
        log.info("%s: white is %s", paths[1], told)
        texts = PngInfo()
        texts.add_text("Description", f"height of the paint: 0 is the bare canvas, {WHITE} is {told}")
        texts.add_text("HeightOfWhite", f"{white:.9g}")
        with replacing(paths[1]) as temporary:
            Image.fromarray(levels_of(height)).save(temporary, format="PNG", pnginfo=texts)
        return paths


def levels_of(height: np.ndarray) -> np.ndarray:
    """Heights (H, W), >= 0, in 16 bits, the highest one white; they are scaled in place, for large ones need memory."""
    highest = float(height.max())
    height *= WHITE / highest if highest > 1e-6 else 0.0  # what is lower is rounding
    return np.rint(height, out=height).clip(0, WHITE).astype(np.uint16)
