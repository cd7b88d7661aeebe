"""Estimate the paint and the time that a plan needs. The constants are estimates, not measurements."""

import numpy as np

from brushexp_changes.tubes.plan import Plan

WET_FILM_MM = 0.2  # thickness of heavy body paint as a brush leaves it
LEFT_OVER = 1.5  # ratio of paint mixed to paint on the canvas; the rest stays on palette and brushes
SECONDS_PER_STROKE = 4.0  # time to find the place of a stroke and paint it
SECONDS_PER_DIP = 5.0
SECONDS_PER_MIXTURE = 300.0  # time to mix one mixture
SECONDS_PER_STAGE = 90.0  # time to rinse the brush and find the next stage
MM2_PER_M_MM = 1000.0  # square millimetres of a stroke 1 m long and 1 mm wide
MM3_PER_ML = 1000.0


def millilitres_of_mixtures(plan: Plan) -> np.ndarray:
    """Estimate the amount (M,) of each mixture in ml, including paint left on the palette."""
    area = np.zeros(len(plan.table.mixtures))
    for stage in plan.stages:
        area[stage.mixture] += stage.metres * stage.brush_mm * MM2_PER_M_MM
    return area * WET_FILM_MM * LEFT_OVER / MM3_PER_ML


def millilitres_of_tubes(plan: Plan) -> dict[str, float]:
    """Estimate the paint needed from each tube in ml; unused tubes are omitted."""
    mixtures = plan.table.mixtures
    if not len(mixtures):
        return {}
    shares = mixtures.parts / mixtures.parts.sum(1, keepdims=True)
    needed = millilitres_of_mixtures(plan) @ shares
    return {tube: float(ml) for tube, ml in zip(mixtures.tubes, needed, strict=True) if ml > 0}


def hours_of(plan: Plan) -> float:
    """Estimate how many hours a person needs to paint the plan, including mixing but excluding drying."""
    used = len({stage.mixture for stage in plan.stages})
    seconds = SECONDS_PER_STROKE * len(plan.order) + SECONDS_PER_DIP * plan.dips
    seconds += SECONDS_PER_MIXTURE * used + SECONDS_PER_STAGE * len(plan.stages)
    return seconds / 3600
