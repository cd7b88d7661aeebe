"""Strokes of one renderer made such that another one can draw them."""

from __future__ import annotations

import logging

import torch

from brushexp.painting.components import Stage
from brushexp.painting.schedule import Schedule
from brushexp.strokes.bezier import curve_of, half_width_of
from brushexp.strokes.catalogue import Catalogue, Strokes

log = logging.getLogger(__name__)
CHANGE_PIXELS = 0.01  # by which a stroke may change without being counted


@torch.no_grad()
def convert_catalogue(catalogue: Catalogue, stage: Stage, schedule: Schedule) -> Strokes:
    """Change the strokes of a catalogue to what the renderer of a stage can draw, and log how many are others now.

    Args:
        catalogue: the strokes; changed in place.
        stage: the one that begins; of the first one nothing is said unless strokes were changed.
        schedule: stands at its first step.

    Returns:
        The strokes as they are now, without gradient.
    """
    strokes = catalogue()
    converted = stage.renderer.convert(strokes)
    if converted is not strokes:
        catalogue.replace(converted)
    points = (curve_of(converted) - curve_of(strokes)).abs().flatten(1).amax(1)
    thickness = 2 * (half_width_of(converted) - half_width_of(strokes)).abs()
    changed = int((torch.maximum(points, thickness) > CHANGE_PIXELS).sum())
    if changed or schedule.stage:
        log.info(
            "step %d: switching to renderer %s; %d of %d strokes were converted to what it can draw",
            schedule.step, stage.name, changed, len(strokes),
        )  # fmt: skip
    return converted
