"""Strokes on superpixels."""

import warnings

import numpy as np
import torch
from torch import Tensor

from brushexp.errors import UserError
from brushexp.init._cells import Look, Orient, exactly, strokes_of_cells
from brushexp.init.base import Initializer
from brushexp.init.grid import lattice
from brushexp.registry import register
from brushexp.strokes.catalogue import Strokes


@register("init", "slic")
class Slic(Initializer):
    """SLIC superpixels (Achanta et al., 2012): a stroke at each centre of mass, in the mean colour.

    Differs from the source in that there are exactly as many as asked: large superpixels are cut across, small ones
    join their neighbours.

    Args:
        compactness: of a superpixel; higher makes them squarer, lower lets them follow the colours.
        orient: structure (along the picture's edges) or random (the thesis's).
        length: of a stroke, in sides of its superpixel (structure only).
        width: of a stroke, in sides of its superpixel (structure only).
        opacity: 0 to 1.
    """

    def __init__(
        self,
        *,
        compactness: float = 10.0,
        orient: Orient = Orient.structure,
        length: float = 1.4,
        width: float = 0.8,
        opacity: float = 0.95,
    ) -> None:
        if not 0 < compactness <= 1e4:
            raise UserError(f"init.compactness={compactness:g} is not within 0 to 10000; try init.compactness=10")
        self.compactness = compactness
        self.look = Look(orient, length, width, opacity)

    def __call__(self, target: Tensor, n_strokes: int, generator: torch.Generator) -> Strokes:
        labels = superpixels(target, n_strokes, self.compactness)
        return strokes_of_cells(target, labels, n_strokes, self.look, generator)


def superpixels(target: Tensor, n: int, compactness: float) -> np.ndarray:
    """Number (H, W) of each pixel's superpixel, exactly ``n`` of them; a plain lattice where they have few pixels."""
    from skimage.segmentation import slic  # noqa: PLC0415  (slow to import)

    _, height, width = target.shape
    if n * 4 > height * width or min(height, width) < 2:
        return lattice(height, width, n)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about pictures it finds small
        labels = slic(
            target.permute(1, 2, 0).numpy(),
            n_segments=n,
            compactness=compactness,
            min_size_factor=0.1,  # small ones are wanted: a stroke for each detail
            start_label=0,
            channel_axis=-1,
        )
    return exactly(labels, n)
