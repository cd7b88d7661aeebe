"""Export the painting as a JPEG."""

import struct
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated

import numpy as np
from PIL import Image, ImageCms

from brushexp.contracts import UserError, between, register
from brushexp.contracts.families import ExportJob
from brushexp.contracts.files import replacing
from brushexp.contracts.members import SheetExporter

LARGEST_SIDE = 65_500  # pixels; the limit of libjpeg
MADE = slice(24, 36)  # bytes of an ICC profile that hold its creation time: year, month, day, ...


@register("to", "jpg")
@dataclass(kw_only=True)
class Jpg(SheetExporter):
    """Writes ``painting.jpg``: the picture at any ``resolution``, small enough to send, with an sRGB profile.

    Colours are stored for every pixel (4:4:4), because strokes have sharp edges. Unlike PNG export, this exporter holds
    the whole picture in memory.

    Args:
        quality: JPEG quality, from 1 (small) to 100; above 95, files grow with little gain in quality.
    """

    quality: Annotated[int, between(1, 100)] = 92

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        sheet = self.sheet(job)
        if max(sheet.size) > LARGEST_SIDE:
            excess = f"to=jpg holds {LARGEST_SIDE} pixels per side, but this picture has {max(sheet.size)}"
            raise UserError(f"{excess}; choose a smaller resolution=, or to=png")
        picture = Image.fromarray(np.concatenate([*self.rows(sheet)]))
        density = {} if self.density is None else {"dpi": (round(self.density),) * 2}
        with replacing(folder / "painting.jpg") as temporary:
            picture.save(
                temporary,
                "JPEG",
                quality=self.quality,
                subsampling=0,
                progressive=True,
                icc_profile=srgb_profile(),
                **density,
            )
        return [folder / "painting.jpg"]


@cache
def srgb_profile() -> bytes:
    """Make an sRGB profile whose bytes are always the same."""
    profile = bytearray(ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes())
    profile[MADE] = struct.pack(">6H", 2000, 1, 1, 0, 0, 0)
    return bytes(profile)
