"""Write the painting as layers (Adobe's PSD, version 1), for Photoshop, Affinity, Procreate, Krita, GIMP and others."""

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from PIL import Image

from brushexp.contracts import UserError, between, register
from brushexp.contracts.families import ExportJob
from brushexp.contracts.files import replacing
from brushexp.contracts.members import DPI, PrintExporter, over_white
from brushexp_exports.jpg import srgb_profile
from brushexp_exports.layers import layers_of

if TYPE_CHECKING:
    from psd_tools.psd.image_resources import ImageResources

LARGEST_SIDE = 30_000  # pixels; the limit of the format
FIXED = 2**16  # denominator of the fixed-point numbers that store resolutions
PER_INCH, CENTIMETRES = 1, 2  # the format's codes for units


@register("to", "psd")
@dataclass(kw_only=True)
class Psd(PrintExporter):
    """Writes ``painting.psd``, the layers of ``to=ora`` for other programs; needs ``pip install 'brushexp[psd]'``.

    The layers are the ground, strokes from bottom to top, light and paper; together they show the painting to within
    two 8-bit levels. The file has an sRGB profile, and contains the finished picture for programs that do not read
    layers. The whole painting is held in memory at once.

    Args:
        layers: number of stroke layers; all have the same number of strokes.
    """

    layers: Annotated[int, between(1, 64)] = 5

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        try:
            from psd_tools import PSDImage  # noqa: PLC0415  (the extra ``psd``)
            from psd_tools.constants import Compression  # noqa: PLC0415
            from psd_tools.psd import PSD  # noqa: PLC0415
            from psd_tools.psd.header import FileHeader  # noqa: PLC0415
            from psd_tools.psd.image_data import ImageData  # noqa: PLC0415
        except ImportError as error:
            raise UserError("to=psd needs psd-tools; install it with: pip install 'brushexp[psd]'") from error
        job = self.scale_to_paper(job)
        height, width = job.size
        if max(job.size) > LARGEST_SIDE:
            excess = f"to=psd holds {LARGEST_SIDE} pixels per side, but this picture has {max(job.size)}"
            raise UserError(f"{excess}; choose a smaller resolution=, or to=ora")
        finished, layers = layers_of(job, self.layers)
        document = PSD(FileHeader(channels=4, height=height, width=width), image_resources=self._resources())
        image = PSDImage(document)  # if this has an alpha channel, layers get alpha instead of a mask
        for layer in layers:
            pixels = Image.fromarray(layer.pixels)
            left, top, right, bottom = pixels.getchannel("A").getbbox() or (0, 0, 1, 1)
            image.create_pixel_layer(pixels.crop((left, top, right, bottom)), layer.name, top, left)
        if finished.shape[2] == 4:  # the format stores colours over white, and a flag that alpha is not a selection
            finished = np.dstack([over_white(finished[..., :3], finished[..., 3:]), finished[..., 3]])
            info = document.layer_and_mask_information.layer_info
            assert info is not None
            info.layer_count *= -1
        channels = [finished[..., k].tobytes() for k in range(finished.shape[2])]
        document.header.channels = len(channels)
        document.image_data = ImageData(Compression.RLE)
        document.image_data.set_data(channels, document.header)
        with replacing(folder / "painting.psd") as temporary, temporary.open("wb") as file:
            document.write(file)
        return [folder / "painting.psd"]

    def _resources(self) -> "ImageResources":
        """Make the image resources that store the file's colour profile and resolution."""
        from psd_tools.constants import Resource  # noqa: PLC0415
        from psd_tools.psd.image_resources import ImageResource, ImageResources  # noqa: PLC0415

        resources = ImageResources.new()
        resources[Resource.ICC_PROFILE] = ImageResource(key=Resource.ICC_PROFILE, data=srgb_profile())
        info = struct.pack(">IHHIHH", *2 * (round(FIXED * (self.density or DPI)), PER_INCH, CENTIMETRES))
        resources[Resource.RESOLUTION_INFO] = ImageResource(key=Resource.RESOLUTION_INFO, data=info)
        return resources
