"""Anybody's strokes, as they are scored: labels (PNG, npy, npz), curves (npz), a catalogue, or what was recovered."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from brushexp.errors import UserError
from brushexp.strokes.bezier import curve_of
from brushexp.strokes.saved import Saved
from brushexp.strokes.storage import load_catalogue
from brushexp.system.hdf5 import opened
from brushexp_recovery.outlines import covers_of, seen_of
from brushexp_recovery.raster.labels import count_pixels, mean_colors
from brushexp_recovery.raster.npz import read_npz
from brushexp_recovery.storage import GROUP, Recovered, read_recovered
from brushexp_recovery.truth import ROUND

Array = NDArray[Any]

ENDS = (0.02, 0.98)  # shares of a region's pixels between which it extends


@dataclass(frozen=True)
class Given:
    """N strokes that somebody found, bottom to top; pixels, x to the right, y down."""

    labels: Array  # (H, W) int32, the stroke that is seen, -1 the ground
    curve: Array  # (N, 3, 2)
    width: Array  # (N,)
    color: Array  # (N, 3) sRGB in [0, 1]
    area: Array  # (N,) pixels, hidden parts too
    ordered: bool = True  # whether their order means anything
    confidence: Array | None = None  # (N,) in [0, 1]

    def __len__(self) -> int:
        return len(self.width)


def given_curves(curve: Array, width: Array, color: Array, opacity: Array, size: tuple[int, int]) -> Given:
    """Take strokes as round-ended lines, bottom to top, on a canvas (H, W)."""
    labels, area = seen_of(covers_of(curve, width, size), opacity, size)
    return Given(labels, curve, width, color, area)


def given_labels(labels: Array, image: Array | None = None) -> Given:
    """Take the regions of a picture (H, W) of whole numbers, -1 the ground, as strokes without an order.

    Each becomes a straight line along its principal axis; its colour is the mean of an ``image`` (H, W, 3), else grey.
    """
    numbers, flat = np.unique(labels[labels >= 0], return_inverse=True)
    compact = np.full(labels.shape, -1, np.int32)
    compact[labels >= 0] = flat
    curve, width = lines_of(compact, len(numbers))
    color = np.full((len(numbers), 3), 0.5) if image is None else mean_colors(compact, image, len(numbers))
    return Given(compact, curve, width, color, count_pixels(compact, len(numbers)).astype(float), ordered=False)


def lines_of(labels: Array, count: int) -> tuple[Array, Array]:
    """Lay a straight line (count, 3, 2) along each region, and find its width (count,) with as many pixels."""
    curve, width = np.zeros((count, 3, 2)), np.zeros(count)
    flat = labels.ravel()
    order = np.argsort(flat, kind="stable")
    first = np.searchsorted(flat[order], np.arange(count + 1))
    for number in range(count):
        pixel = order[first[number] : first[number + 1]]
        places = np.stack([pixel % labels.shape[1], pixel // labels.shape[1]], 1) + 0.5
        middle = places.mean(0)
        away = places - middle
        way = np.linalg.eigh(away.T @ away)[1][:, 1]
        low, high = np.quantile(away @ way, ENDS) + np.array([-0.5, 0.5])
        extent = high - low
        wide = min(len(pixel) / extent, extent)
        width[number] = min(len(pixel) / max(extent - ROUND * wide, 1), extent)
        ends = np.array([low, 0.5 * (low + high), high]) + min(0.5 * width[number], 0.49 * extent) * np.array(
            [1, 0, -1]
        )
        curve[number] = middle + ends[:, None] * way
    return curve, width


def given_catalogue(saved: Saved, size: tuple[int, int]) -> Given:
    """Take the strokes of a catalogue, enlarged to the width of a canvas (H, W)."""
    up, zoom = saved.depth.argsort().numpy(), size[1] / saved.size[1]
    strokes = saved.strokes
    curve, width = curve_of(strokes).numpy()[up] * zoom, (strokes.width * strokes.scale).numpy()[up] * zoom
    return given_curves(curve, width, strokes.color.numpy()[up], strokes.opacity.numpy()[up], size)


def given_recovered(found: Recovered) -> Given:
    """Take what was recovered: strokes with the regions in which they are seen, and their confidence."""
    given, up = given_catalogue(found.saved, found.labels.shape), found.saved.depth.argsort().numpy()
    rank = np.append(np.argsort(up), -1)
    labels = rank[found.labels].astype(np.int32)
    area = count_pixels(labels, len(given)).astype(float)
    return replace(given, labels=labels, area=area, confidence=found.confidence[up].astype(float))


def is_recovered(path: Path) -> bool:
    """Tell whether a catalogue has regions and confidences of recovered strokes."""
    if path.suffix.lower() != ".h5":
        return False
    with opened(path, "give another one") as file:
        return GROUP in file


def read_given(path: Path, size: tuple[int, int], image: Array | None = None, key: str = "strokes") -> Given:
    """Read somebody's strokes for a canvas (H, W); a UserError says what would be right.

    Labels: .npy or .npz (``labels``), -1 the ground, or .png, where black is the ground and each grey level or colour
    is a stroke. Curves: .npz with ``curve`` (N, 3, 2) and ``width`` (N,), bottom to top, beside or instead of labels,
    and if there are ``color``, ``opacity``, ``area``, ``confidence``, ``ordered``. Catalogues: .h5, .json.
    """
    suffix = path.suffix.lower()
    if suffix in (".h5", ".json"):
        saved = load_catalogue(path, key)
        if saved.size == size and is_recovered(path):
            return given_recovered(read_recovered(path))
        return given_catalogue(saved, size)
    if suffix == ".npz":
        return _given_arrays(path, read_npz(path), size, image)
    if suffix not in (".npy", ".png"):
        raise UserError(f"{key}={path} is no kind of strokes that is known; give labels as .png or .npy, .npz or .h5")
    labels = _array_in(path) if suffix == ".npy" else _labels_in(path)
    return given_labels(_fitting(path, labels, size), image)


def _given_arrays(path: Path, values: dict[str, Array], size: tuple[int, int], image: Array | None) -> Given:
    if "width" not in values or "curve" not in values:
        if "labels" not in values:
            raise UserError(f"{path} has neither labels nor curve and width; save one of them in it")
        return given_labels(_fitting(path, values["labels"], size), image)
    count = len(values["width"])
    gray, whole = np.full((count, 3), 0.5), np.ones(count)
    color, opacity = values.get("color", gray), values.get("opacity", whole)
    given = given_curves(values["curve"].astype(float), values["width"].astype(float), color, opacity, size)
    if "labels" in values:
        labels = _fitting(path, values["labels"], size)
        if labels.max(initial=-1) >= count:
            raise UserError(f"{path}: labels go to {labels.max()}, and there are {count} curves; number them from 0")
        area = values.get("area", count_pixels(labels, count)).astype(float)
        given = replace(given, labels=labels.astype(np.int32), area=area)
    ordered = bool(values.get("ordered", True))
    return replace(given, ordered=ordered, confidence=values.get("confidence"))


def _array_in(path: Path) -> Array:
    try:
        array: Array = np.load(path, allow_pickle=False)
    except Exception as error:
        raise UserError(f"{path} is no npy of plain numbers: {error}") from error
    return array


def _labels_in(path: Path) -> Array:
    """Read a PNG whose colours, or grey levels, are strokes; black is the ground."""
    try:
        with Image.open(path) as picture:
            pixels = np.asarray(picture.convert("RGB") if picture.mode in ("P", "RGBA", "LA") else picture).astype(int)
    except Exception as error:
        raise UserError(f"{path} cannot be read as a picture: {error}") from error
    return (pixels if pixels.ndim == 2 else pixels @ np.array([65536, 256, 1])) - 1


def _fitting(path: Path, labels: Array, size: tuple[int, int]) -> Array:
    if labels.shape != size or labels.dtype.kind not in "iu":
        raise UserError(
            f"{path}: labels are {labels.dtype} of shape {labels.shape}; whole numbers of shape {size} are needed, "
            "a number of a stroke at each pixel of the painting"
        )
    return labels
