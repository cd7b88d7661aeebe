"""Write the painting as a lit relief, with height and normal maps for printers and 3-D programs."""

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from brushexp.contracts import register
from brushexp.contracts.families import Exporter, ExportJob
from brushexp.contracts.files import as_shown, replacing, to_bytes, write_picture
from brushexp.contracts.layers import UNLIT, normals_of, shade_picture
from brushexp.contracts.machine import check_memory

log = logging.getLogger(__name__)
WHITE = 2**16 - 1  # level of the highest point in height.png
BYTES_PER_PIXEL = 14  # memory for 32-bit heights, two pictures, and Pillow's copy of one of them


@register("to", "relief")
class Relief(Exporter):
    """Writes ``relief.png``, a picture of thick paint under ``light=315,45``, with ``height.png`` and ``normals.png``.

    The lamp is the painting's own unless ``light.*`` sets another; paintings without light get ``light.depth=1``.

    ``height.png`` has 16 bits: black is the bare canvas, and white is the highest point, whose height is given in the
    log and in the file's text fields ``Description`` and ``HeightOfWhite`` (pixels). ``normals.png`` is a tangent-space
    normal map in OpenGL's convention: red points right, green up, blue towards the viewer, and -1 to 1
    is stored as 0 to 255.
    """

    def check(self, count: int, size: tuple[int, int]) -> None:
        what = f"to=relief: {size[1]} x {size[0]} pixels"
        check_memory(BYTES_PER_PIXEL * size[0] * size[1], what, "choose a smaller resolution=")

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        light = job.light if job.light.depth else replace(job.light, depth=1.0)
        height = job.height()
        relief, normals = np.empty((*job.size, 3), np.uint8), np.empty((*job.size, 3), np.uint8)
        for top, band in replace(job, light=UNLIT).bands():
            rows = slice(top, top + band.shape[1])
            facing = normals_of(height, light.depth, rows)
            normals[rows] = to_bytes(torch.from_numpy(0.5 * facing + 0.5))
            lit = shade_picture(band.float().cpu().numpy(), facing, light)
            relief[rows] = to_bytes(torch.from_numpy(lit))
        paths = [folder / name for name in ("relief.png", "height.png", "normals.png")]
        write_picture(paths[0], relief)
        write_picture(paths[2], normals)
        white = light.depth * float(height.max())
        highest = f"{white:.6g} pixels above the bare canvas, {100 * white / max(job.size):.4g} % of the longer side"
        log.info("%s: white is %s", as_shown(paths[1]), highest)
        texts = PngInfo()
        texts.add_text("Description", f"height of the paint: 0 is the bare canvas, {WHITE} is {highest}")
        texts.add_text("HeightOfWhite", f"{white:.9g}")
        with replacing(paths[1]) as temporary:
            Image.fromarray(levels_of(height)).save(temporary, format="PNG", pnginfo=texts)
        return paths


def levels_of(height: np.ndarray) -> np.ndarray:
    """Quantise heights (H, W) >= 0 to 16 bits, so that the highest is white; overwrite the input to save memory."""
    highest = float(height.max())
    height *= WHITE / highest if highest > 1e-6 else 0.0  # lower values are rounding errors
    return np.rint(height, out=height).clip(0, WHITE).astype(np.uint16)
