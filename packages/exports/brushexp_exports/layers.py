"""Split a painting into layers for other programs."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from brushexp.contracts import build_named
from brushexp.contracts.families import ExportJob
from brushexp.contracts.layers import overlay
from brushexp.contracts.strokes import half_width_of

ROUNDING = 2  # levels, of 255, by which 8-bit layers may differ from the painting


@dataclass(frozen=True, eq=False)
class Layer:
    """A layer of a painting, with its name and pixels."""

    name: str
    pixels: np.ndarray  # (H, W, 4) uint8, straight alpha


def layers_of(job: ExportJob, count: int) -> tuple[np.ndarray, list[Layer]]:
    """Paint the picture, (H, W, 3) uint8 or (H, W, 4) if transparent, and its layers, bottom to top.

    The layers are the ground, up to ``count`` layers with equal numbers of strokes, and, if these do not reproduce the
    painting to within `ROUNDING`, a layer ``light and paper`` with the remaining difference. All layers are transparent
    where the painting is transparent.
    """
    picture, alpha, layers = job.picture(), job.alpha(), [*_paint_layers(job, count)]
    shown = _flatten(layers, job.size)
    if not job.is_bare or np.abs(shown.astype(int) - picture).max() > ROUNDING:
        layers.append(Layer("light and paper", overlay(shown, picture)))
    if alpha is None:
        return picture, layers
    return np.dstack([picture, alpha]), [replace(layer, pixels=_cut(layer.pixels, alpha)) for layer in layers]


def _paint_layers(job: ExportJob, count: int) -> Iterator[Layer]:
    """Yield the layer of the ground and the layers of strokes, bottom to top."""
    ground = np.empty((*job.size, 4), np.uint8)
    ground[:] = [*(255 * job.saved.background.cpu()).round().tolist(), 255]
    yield Layer("ground", ground)
    for number in job.bottom_up.tensor_split(min(count, max(1, len(job.strokes)))):
        if len(number):
            width = 2 * float(half_width_of(job.strokes[number]).median())
            name = f"{len(number)} strokes, {width:.3g} pixels wide"
            yield Layer(name, _draw(job, number))


def _draw(job: ExportJob, number: Tensor) -> np.ndarray:
    """Draw the strokes with indices ``number`` (n,) as RGBA (H, W, 4), uint8, with straight alpha.

    Ground, light and paper are omitted, and paint is mixed in RGB. Composited over black or over white, the result
    looks like the strokes painted there.
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


def _cut(pixels: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """Multiply the alpha of a layer (H, W, 4) by the alpha (H, W, 1) of the painting."""
    share = pixels[..., 3:].astype(np.uint16) * alpha
    return np.concatenate([pixels[..., :3], ((share + 127) // 255).astype(np.uint8)], axis=2)


def _flatten(layers: list[Layer], size: tuple[int, int]) -> np.ndarray:
    """Composite layers over black, as other programs do; return (H, W, 3) uint8."""
    below = np.zeros((*size, 3), np.float32)
    for layer in layers:
        share = layer.pixels[..., 3:].astype(np.float32) / 255
        below += share * (layer.pixels[..., :3] - below)
    return (below + 0.5).astype(np.uint8)
