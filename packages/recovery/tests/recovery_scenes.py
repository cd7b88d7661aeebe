"""Paintings with known strokes for recovery tests, and simple methods that find strokes in plain pictures."""

from functools import cache
from typing import Any

import numpy as np
import torch
from brushexp_recovery.benchmark.prediction import prediction_from_labels
from brushexp_recovery.model.recovery_model import RecoveryModel, load_model
from brushexp_recovery.recover.storage import Recovered
from brushexp_recovery.synthesis.canvas import compose, geometry_of, opaque_mixing
from brushexp_recovery.synthesis.hand import Hand
from brushexp_recovery.synthesis.layout import StrokeLayout, lay_strokes
from brushexp_recovery.synthesis.paintings import KnownPainting, as_bytes
from brushexp_recovery.synthesis.windows import BrushLook, StrokeWindows, draw_strokes
from skimage.measure import label

from brushexp.strokes.bezier import strokes_along
from brushexp.strokes.storage import Saved

Array = np.ndarray[Any, Any]


def silent(share: float, state: str) -> None:
    """Ignore reports of progress."""


@cache
def shipped() -> RecoveryModel:
    """Load the shipped weights."""
    return load_model()


def straight(*ends: tuple[tuple[float, float], tuple[float, float]]) -> Array:
    """Make straight curves (N, 3, 2) from pairs of end points."""
    start, end = np.array(ends, float).transpose(1, 0, 2)
    return np.stack([start, 0.5 * (start + end), end], 1)


def plain_strokes(curve: Array, width: float, color: Array | None = None) -> StrokeLayout:
    """Make strokes of equal width, without sway or taper; they are grey unless colours are given."""
    n = len(curve)
    color = np.full((n, 3), 0.4) if color is None else color
    return StrokeLayout(np.asarray(curve, float), np.full(n, width), color, np.zeros(n), np.zeros(n))


def lay_on(windows: StrokeWindows, layout: StrokeLayout, ground: Array, coats: float) -> KnownPainting:
    """Composite opaque strokes over a ground."""
    canvas = compose(windows, layout, opaque_mixing(len(layout), coats), ground)
    return KnownPainting(as_bytes(canvas.image), canvas.labels.astype(np.int16), geometry_of(windows, canvas))


def bars(angle: float = 0.4) -> KnownPainting:
    """Paint two crossing strokes, 20 px wide, on 96 x 128 px with the disc engine; the second stroke is on top."""
    way = 35 * np.array([np.cos(angle), np.sin(angle)])
    ways, middle = np.array([way, [-way[1], way[0]]]), np.array([60.0, 48.0])
    curve = straight(*((middle - way, middle + way) for way in ways))
    layout = plain_strokes(curve, 20.0, np.array([[0.9, 0.1, 0.1], [0.1, 0.2, 0.9]]))
    windows = draw_strokes(layout, BrushLook("engine", "disc", {}, 1.0), 0)
    return lay_on(windows, layout, np.full((96, 128, 3), 0.5), 1.0)


def bristles(size: tuple[int, int], seed: int) -> KnownPainting:
    """Paint about 50 bristle strokes on a canvas (H, W)."""
    random = np.random.default_rng(seed)
    rows, columns = np.mgrid[: size[0], : size[1]] / 200
    picture = np.stack([0.5 + 0.4 * np.sin(4 * rows + 3 * columns + k) for k in range(3)], 2).astype(np.float32)
    layout = lay_strokes(picture, 50, Hand(), random)
    windows = draw_strokes(layout, BrushLook("renderer", "textured", {}), 0)
    return lay_on(windows, layout, np.full((*size, 3), 0.6), 4.0)


def picture_of(painting: KnownPainting) -> Array:
    """Convert the picture of a painting to float32 (H, W, 3) in [0, 1]."""
    return painting.image.astype(np.float32) / 255


def saved_strokes(curve: Array, width: Array, color: Array, size: tuple[int, int], depth: list[int] | None = None):
    """Make a catalogue of opaque strokes, bottom to top unless ``depth`` is given."""
    numbers = (torch.tensor(np.array(value), dtype=torch.float32) for value in (curve, width, color))
    order = torch.tensor(range(len(width)) if depth is None else depth, dtype=torch.int32)
    return Saved(strokes_along(*numbers, 1.0), order, size, torch.ones(3), "analytic")


def recover_dark(image: Array, confidence: float) -> Recovered:
    """Find separate dark strokes, and give all of them the same confidence."""
    found = prediction_from_labels(label(image.mean(2) < 0.5) - 1, image)
    saved = saved_strokes(found.curve, found.width, found.color, image.shape[:2])
    return Recovered(saved, np.full(len(found), confidence, np.float32), found.labels)


def f1_of(labels: Array, truth: Array) -> float:
    """Compute the F1 between the regions of two label images at an IoU of 0.5."""
    counts = [np.bincount(one[one >= 0]) for one in (labels, truth)]
    both = (labels >= 0) & (truth >= 0)
    pairs, number = np.unique(np.stack([labels[both], truth[both]]), axis=1, return_counts=True)
    hits = (number / (counts[0][pairs[0]] + counts[1][pairs[1]] - number) >= 0.5).sum()
    return float(2 * hits / sum((one >= 12).sum() for one in counts))
