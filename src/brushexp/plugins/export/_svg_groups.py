"""Divide the strokes of an SVG into layers, and each layer by colour, for the layer lists of design programs."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from brushexp.pictures.load import BRIGHTNESS
from brushexp.plugins.export.base import ExportJob

ITERATIONS = 20  # iterations of k-means


@dataclass(frozen=True, eq=False)
class Group:
    """A group of strokes, given by their indices ``number`` (n,) in the catalogue, bottom stroke first."""

    layer: int  # from 1, the bottom layer
    color: str | None  # '#rrggbb', the mean colour of the strokes; None if layers are not divided
    number: Tensor


def stroke_groups(job: ExportJob, layers: int, colors: int) -> Iterator[Group]:
    """Yield all strokes in groups: layers of about equal size, from bottom to top, each divided by colour, dark first.

    ``colors`` is the number of k-means clusters, in sRGB, of all stroke colours; if it is 0, layers are not divided,
    and the strokes keep their order.
    """
    order = job.bottom_up.cpu()
    parts = order.tensor_split(max(1, min(layers, len(order))))
    if not colors or not len(order):
        yield from (Group(k, None, part) for k, part in enumerate(parts, start=1))
        return
    color = job.strokes.color.detach().cpu().numpy().astype(np.float64)
    means, cluster = _clusters(color, min(colors, len(np.unique(color, axis=0))))
    dark_to_light = np.argsort(means @ np.array(BRIGHTNESS), kind="stable")
    for k, part in enumerate(parts, start=1):
        for one in dark_to_light:
            number = part[torch.from_numpy(cluster[part.numpy()] == one)]
            if len(number):
                name = "#" + bytes((255 * means[one] + 0.5).clip(0, 255).astype(np.uint8).tolist()).hex()
                yield Group(k, name, number)


def _clusters(color: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Cluster colours (N, 3) with k-means; return the means (count, 3) and the cluster (N,) of each colour."""
    from scipy.cluster.vq import kmeans2  # noqa: PLC0415  (slow to import)

    means, cluster = kmeans2(color, count, iter=ITERATIONS, minit="++", seed=0, missing="warn")
    return means, cluster
