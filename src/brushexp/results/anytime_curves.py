"""Read each run's PSNR over time, average the curves, and find which setting led at each time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from pandas import DataFrame

Curve = tuple[np.ndarray, np.ndarray]  # seconds of optimisation, ascending, and PSNR in dB
LEAD = 0.1  # dB by which a run must beat the leader to replace it


def curve_from(points: Any) -> Curve | None:
    """Return a run's curve from the pairs recorded as ``anytime``, or None if there are fewer than two points."""
    try:
        pairs = np.array(points or [], float).reshape(-1, 2)
    except (TypeError, ValueError, OverflowError):
        return None
    pairs = pairs[np.isfinite(pairs).all(1)]
    pairs = pairs[pairs[:, 0].argsort(kind="stable")]
    return (pairs[:, 0], pairs[:, 1]) if len(pairs) > 1 else None


def mean_curve(curves: Sequence[Curve]) -> Curve:
    """Average the PSNR of several runs once all of them have a value; a finished run keeps its final value."""
    times = np.unique(np.concatenate([seconds for seconds, _ in curves]))
    times = times[times >= max(seconds[0] for seconds, _ in curves)]
    return times, np.mean([np.interp(times, *curve) for curve in curves], axis=0)


def leaders(curves: Mapping[str, Curve]) -> list[tuple[float, str]]:
    """Return, in order, each time (in seconds) at which a setting took the lead, paired with the setting's name.

    A setting takes the lead when its best PSNR so far beats the leader's by ``LEAD``; a finished run keeps its best.
    """
    times = np.unique(np.concatenate([seconds for seconds, _ in curves.values()]))
    best = [np.interp(times, seconds, np.maximum.accumulate(psnr), left=-math.inf) for seconds, psnr in curves.values()]
    names, leader, changes = list(curves), None, []
    for time, psnr in zip(times, np.stack(best, axis=1), strict=True):
        first = int(psnr.argmax())
        if leader is None or psnr[first] > psnr[leader] + LEAD:
            leader = first
            changes.append((float(time), names[leader]))
    return changes


def curves_by_image(frame: DataFrame) -> dict[str, dict[str, list[Curve]]]:
    """Group the curves of runs by image and by label; runs without a label or a curve are left out."""
    curves: dict[str, dict[str, list[Curve]]] = {}
    for image, label, points in frame["run"][["image", "label", "anytime"]].dropna(subset=["label"]).to_numpy():
        if (curve := curve_from(points)) is not None:
            curves.setdefault(image, {}).setdefault(label, []).append(curve)
    return curves


def mean_curves(curves: Mapping[str, list[Curve]]) -> dict[str, Curve]:
    """Average the curves of each setting over its seeds; settings with fewer than two points are left out."""
    means = {label: mean_curve(alike) for label, alike in curves.items()}
    return {label: curve for label, curve in means.items() if len(curve[0]) > 1}
