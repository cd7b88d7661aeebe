"""Write the painting as layers (OpenRaster 0.0.6), for Krita, GIMP, MyPaint and others."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Annotated
from xml.sax.saxutils import quoteattr
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile, ZipInfo

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from brushexp.bounds import between
from brushexp.plugins.export.base import ExportJob
from brushexp.plugins.export.prints import PrintExporter
from brushexp.registry import build_named, register
from brushexp.shading.light import overlay
from brushexp.strokes.bezier import half_width_of
from brushexp.system.files import replacing

THUMBNAIL = 256  # pixels of its longer side at most
ROUNDING = 2  # levels of 255 by which layers of 8 bits may differ from the painting
LAYER = (
    '  <layer name={} src="data/{}.png" x="0" y="0" opacity="1.0" composite-op="svg:src-over" visibility="visible"/>\n'
)


@dataclass(frozen=True, eq=False)
class Layer:
    """A picture with its name in the list of layers."""

    name: str
    pixels: np.ndarray  # (H, W, 4) uint8, straight alpha


@register("to", "ora")
@dataclass(kw_only=True)
class OpenRaster(PrintExporter):
    """``painting.ora``: the ground, the strokes in layers from the lowest, large ones to small ones, light and paper.

    Layers show the painting when all are seen, to two levels of 255, and each can be changed, hidden or lit anew. The
    uppermost, ``light and paper``, is what the strokes alone do not show: lamp, paper and a mixing of paint that is not
    that of light (``color=``). With ``background=transparent`` every layer ends where the picture does. All of it is in
    memory at once.

    Args:
        layers: in how many layers the strokes are, with the same number of strokes each.
    """

    layers: Annotated[int, between(1, 64)] = 5

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        job = self.scale_to_paper(job)
        finished, layers = picture_of(job), [*self._painted(job)]
        shown, colors = flattened(layers, job.size), finished[..., :3]
        if not job.is_bare or np.abs(shown.astype(int) - colors).max() > ROUNDING:
            layers.append(Layer("light and paper", overlay(shown, colors)))
        with replacing(folder / "painting.ora") as temporary, ZipFile(temporary, "w") as archive:
            _add(archive, "mimetype", b"image/openraster", ZIP_STORED)
            _add(archive, "stack.xml", self._stack(job, layers).encode())
            for number, layer in enumerate(layers):
                _add(archive, f"data/{number}.png", png_of(cut(layer.pixels, job)))
            _add(archive, "mergedimage.png", png_of(finished))
            small = Image.fromarray(finished)
            small.thumbnail((THUMBNAIL, THUMBNAIL))
            _add(archive, "Thumbnails/thumbnail.png", png_of(np.asarray(small)))
        return [folder / "painting.ora"]

    def _painted(self, job: ExportJob) -> Iterator[Layer]:
        """Draw ground and strokes, the lowest layer first."""
        ground = np.empty((*job.size, 4), np.uint8)
        ground[:] = [*(255 * job.saved.background.cpu()).round().tolist(), 255]
        yield Layer("ground", ground)
        for number in job.bottom_up.tensor_split(min(self.layers, max(1, len(job.strokes)))):
            if len(number):
                width = 2 * float(half_width_of(job.strokes[number]).median())
                name = f"{len(number)} strokes, {width:.3g} pixels wide"
                yield Layer(name, layer_of(job, number))

    def _stack(self, job: ExportJob, layers: list[Layer]) -> str:
        """List the layers, the uppermost first, as the form wants them."""
        height, width = job.size
        dots = f' xres="{self.density:.0f}" yres="{self.density:.0f}"' if self.density else ""
        rows = [LAYER.format(quoteattr(layer.name), number) for number, layer in enumerate(layers)]
        head = f'<?xml version="1.0" encoding="UTF-8"?>\n<image version="0.0.6" w="{width}" h="{height}"{dots}>\n'
        return f"{head} <stack>\n{''.join(reversed(rows))} </stack>\n</image>\n"


def layer_of(job: ExportJob, number: Tensor) -> np.ndarray:
    """Draw strokes (n,) by their numbers without ground, light and paper: (H, W, 4) uint8, straight alpha.

    Colour and alpha are those that give what is drawn over black and over white, where paint mixes as numbers.
    """
    some = replace(job.saved, strokes=job.strokes[number], depth=job.saved.depth[number])
    plain = replace(job.bare(), space=build_named("color", "rgb", {}))
    black, white = (
        torch.cat([band.cpu() for _, band in replace(plain, saved=replace(some, background=ground)).bands()], dim=1)
        for ground in (torch.zeros(3), torch.ones(3))
    )
    alpha = (1 - (white - black).mean(0, keepdim=True)).clamp(0, 1)
    color = torch.where(alpha > 0, black / alpha.clamp_min(1e-6), 0).clamp(0, 1)
    return (255 * torch.cat([color, alpha])).round().to(torch.uint8).movedim(0, 2).numpy()


def picture_of(job: ExportJob) -> np.ndarray:
    """Paint what is seen: (H, W, 3) uint8, or (H, W, 4) where it is transparent."""
    alpha, picture = job.alpha(), job.picture()
    return picture if alpha is None else np.dstack([picture, alpha])


def cut(pixels: np.ndarray, job: ExportJob) -> np.ndarray:
    """Make a layer (H, W, 4) as transparent as its painting is."""
    alpha = job.alpha()
    if alpha is None:
        return pixels
    share = pixels[..., 3:].astype(np.uint16) * alpha
    return np.concatenate([pixels[..., :3], ((share + 127) // 255).astype(np.uint8)], axis=2)


def flattened(layers: list[Layer], size: tuple[int, int]) -> np.ndarray:
    """Lay layers over each other as programs do: (H, W, 3) uint8, over black."""
    below = np.zeros((*size, 3), np.float32)
    for layer in layers:
        share = layer.pixels[..., 3:].astype(np.float32) / 255
        below += share * (layer.pixels[..., :3] - below)
    return (below + 0.5).astype(np.uint8)


def png_of(pixels: np.ndarray) -> bytes:
    """Pack pixels as PNG."""
    Image.fromarray(pixels).save(file := BytesIO(), "PNG")
    return file.getvalue()


def _add(archive: ZipFile, name: str, data: bytes, packing: int = ZIP_DEFLATED) -> None:
    """Add a file with no time, so that the same painting has the same bytes."""
    archive.writestr(ZipInfo(name), data, packing)
