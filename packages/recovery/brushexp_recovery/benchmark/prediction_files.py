"""Read predicted strokes from files: labels (PNG, npy, npz), curves (npz) and catalogues."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from brushexp.contracts import UserError
from brushexp.contracts.files import catalogue_suffixes, open_hdf5
from brushexp.contracts.strokes import load_catalogue
from brushexp_recovery.benchmark.prediction import (
    GREY,
    Prediction,
    prediction_from_catalogue,
    prediction_from_curves,
    prediction_from_labels,
    prediction_from_recovered,
)
from brushexp_recovery.raster.labels import count_pixels
from brushexp_recovery.raster.npz import read_npz
from brushexp_recovery.recover.storage import GROUP, read_recovered

Array = NDArray[Any]

BASE = np.array([65536, 256, 1])  # factors that combine red, green and blue into one number


def read_prediction(path: Path, size: tuple[int, int], image: Array | None = None, key: str = "strokes") -> Prediction:
    """Read predicted strokes for a canvas (H, W); raise a UserError that describes a valid file.

    Labels: .npy or .npz (``labels``) with -1 for the ground, or .png, in which black is the ground and every other grey
    level or colour is a stroke. Curves: .npz with ``curve`` (N, 3, 2) and ``width`` (N,), bottom to top, with or
    without labels, and optionally ``color``, ``opacity``, ``area``, ``confidence`` and ``ordered``. Catalogues: any
    format.
    """
    suffix = path.suffix.lower()
    if suffix in catalogue_suffixes():
        saved = load_catalogue(path, key)
        if saved.size == size and is_recovered(path):
            return prediction_from_recovered(read_recovered(path))
        return prediction_from_catalogue(saved, size)
    if suffix == ".npz":
        return _prediction_from_arrays(path, read_npz(path), size, image)
    if suffix not in (".npy", ".png"):
        raise UserError(f"{key}={path} is not a known file of strokes; give labels as .png or .npy, .npz or .h5")
    labels = _read_npy(path) if suffix == ".npy" else _read_png(path)
    return prediction_from_labels(_check_labels(path, labels, size), image)


def is_recovered(path: Path) -> bool:
    """Check whether a catalogue contains the visible regions and confidences of recovered strokes."""
    if path.suffix.lower() != ".h5":
        return False
    with open_hdf5(path, "give another one") as file:
        return GROUP in file


def _prediction_from_arrays(
    path: Path, values: dict[str, Array], size: tuple[int, int], image: Array | None
) -> Prediction:
    """Make a prediction from the curves in an npz file, or from its labels if it contains no curves."""
    if "width" not in values or "curve" not in values:
        if "labels" not in values:
            raise UserError(f"{path} has neither labels nor curve and width; add one of them")
        return prediction_from_labels(_check_labels(path, values["labels"], size), image)
    count = len(values["width"])
    color, opacity = values.get("color", np.full((count, 3), GREY)), values.get("opacity", np.ones(count))
    curve, width = values["curve"].astype(float), values["width"].astype(float)
    prediction = prediction_from_curves(curve, width, color, opacity, size)
    if "labels" in values:
        labels = _check_labels(path, values["labels"], size)
        if labels.max(initial=-1) >= count:
            raise UserError(f"{path}: labels go up to {labels.max()}, but there are {count} curves; number them from 0")
        area = values.get("area", count_pixels(labels, count)).astype(float)
        prediction = replace(prediction, labels=labels.astype(np.int32), area=area)
    ordered = bool(values.get("ordered", True))
    return replace(prediction, ordered=ordered, confidence=values.get("confidence"))


def _read_npy(path: Path) -> Array:
    try:
        array: Array = np.load(path, allow_pickle=False)
    except Exception as error:
        raise UserError(f"{path} is damaged, or not an npy of plain numbers; get it again") from error
    return array


def _read_png(path: Path) -> Array:
    """Read a label image from a PNG in which black is the ground and every other colour or grey level is a stroke."""
    try:
        with Image.open(path) as picture:
            pixels = np.asarray(picture.convert("RGB") if picture.mode in ("P", "RGBA", "LA") else picture).astype(int)
    except Exception as error:
        raise UserError(f"{path} is damaged, or not a picture; get it again") from error
    return (pixels if pixels.ndim == 2 else pixels @ BASE) - 1


def _check_labels(path: Path, labels: Array, size: tuple[int, int]) -> Array:
    """Return labels if they are integers of the shape (H, W); raise UserError otherwise."""
    if labels.shape != size or labels.dtype.kind not in "iu":
        raise UserError(
            f"{path}: labels are {labels.dtype} of shape {labels.shape}; give whole numbers of shape {size}, "
            "the number of a stroke at each pixel of the painting"
        )
    return labels
