"""Plan a painting with the table that was used to make it, or with a table applied afterwards."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import torch

from brushexp.contracts import UserError, build_named
from brushexp.contracts.families import ExportJob
from brushexp.contracts.painting import recorded_settings
from brushexp_changes.tubes.mixtures import Mixtures, all_mixtures
from brushexp_changes.tubes.paints import load_tubes
from brushexp_changes.tubes.plan import Plan, plan_of
from brushexp_changes.tubes.tubes import OfTubes

OPTIONS = [one.name for one in fields(OfTubes) if one.init]  # options that the exporters share
MM_PER_CM = 10
COLOR_TOLERANCE = 1e-4  # Euclidean distance in RGB below which a colour is the mixture's


def recorded_plan(job: ExportJob, options: Mapping[str, Any]) -> tuple[Plan, bool]:
    """Plan a painting with its recorded table; return the plan, and whether that table applies unchanged.

    ``options`` override the recorded options of ``change=tubes``; None keeps a recorded value. A painting made without
    ``tubes``, or with other tubes, mixtures or brushes, is converted to the nearest mixtures and brushes afterwards.
    """
    recorded = (recorded_settings(job.saved).get("change") or {}).get("tubes") or {}
    given = {name: options[name] for name in OPTIONS if options.get(name) is not None}
    tubes = _build({name: recorded[name] for name in OPTIONS if name in recorded} | given)
    candidates = all_mixtures(load_tubes(tubes.tubes))
    own = None if {"tubes", "mixtures"} & given.keys() or not recorded else mixtures_in(job, candidates)
    if own is None:
        table = tubes.table_for(torch.from_numpy(job.bare().picture()).movedim(2, 0) / 255, candidates)
    else:
        table = tubes.table_of(own, job.size[1])
    plan = plan_of(job, table, job.size[1] / (MM_PER_CM * tubes.width_cm))
    return plan, own is not None and "brushes" not in given


def _build(options: dict[str, Any]) -> OfTubes:
    try:
        tubes: OfTubes = build_named("change", "tubes", options)
    except UserError as error:
        cure = "give to.plan.tubes=eight, and correct the other options"
        raise UserError(f"the plan cannot use the table of tubes and brushes: {error}; {cure}") from error
    return tubes


def mixtures_in(job: ExportJob, candidates: Mixtures) -> Mixtures | None:
    """Find the mixtures used in a painting, from dark to light; return None if any stroke has another colour."""
    colors = torch.unique(job.strokes.color.detach().cpu(), dim=0)
    if not len(colors):
        return None
    away, number = torch.cdist(colors.double(), candidates.color.double()).min(1)
    return candidates[number.unique().numpy()].from_dark() if bool((away < COLOR_TOLERANCE).all()) else None
