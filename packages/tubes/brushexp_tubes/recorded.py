"""Plan a painting with the table that it was made with, or with one that is put on afterwards."""

from collections.abc import Mapping
from typing import Any

import torch
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from brushexp.config.keys import keys_of, with_types
from brushexp.errors import UserError
from brushexp.painting.reopen import recorded_settings
from brushexp.plugins.export.base import ExportJob
from brushexp_tubes.mixtures import Mixtures, all_mixtures
from brushexp_tubes.paints import load_tubes
from brushexp_tubes.plan import Plan, plan_of
from brushexp_tubes.schema import TubesTask
from brushexp_tubes.task import table_for, table_with

KEYS = ("tubes", "mixtures", "brushes", "width_cm", "load")  # of ``task=tubes``, and options of exporters
SAME = 1e-4  # of a channel: a colour that is nearer is that of the mixture


def recorded_plan(job: ExportJob, options: Mapping[str, Any]) -> tuple[Plan, bool]:
    """Plan a painting with the table that it was painted with, and tell whether it was.

    ``options`` are keys of ``task=tubes`` that differ from that, or None. A painting by other tasks, or of which tubes,
    mixtures or brushes differ, gets the nearest mixtures and brushes afterwards.
    """
    settings = recorded_settings(job.saved)
    given = {name: options[name] for name in KEYS if options.get(name) is not None}
    cfg = _checked({name: settings[name] for name in KEYS if name in settings} | given)
    candidates = all_mixtures(load_tubes(cfg.tubes))
    own = None if {"tubes", "mixtures"} & given.keys() or "tubes" not in settings else mixtures_in(job, candidates)
    if own is None:
        table = table_for(cfg, torch.from_numpy(job.bare().picture()).movedim(2, 0) / 255, candidates)
    else:
        table = table_with(cfg, own, job.size[1])
    return plan_of(job, table, job.size[1] / (10 * cfg.width_cm)), own is not None and "brushes" not in given


def _checked(values: dict[str, Any]) -> DictConfig:
    """Give values of keys of ``task=tubes`` their types, and others their defaults; a UserError for a wrong one."""
    try:
        cfg = with_types(TubesTask, OmegaConf.create(values))
    except OmegaConfBaseException as error:
        raise UserError(
            f"the plan cannot use what the catalogue says of its table: {error.msg}; give to.plan.tubes=eight"
        ) from error
    for name in KEYS:
        value = OmegaConf.to_object(cfg[name]) if OmegaConf.is_config(cfg[name]) else cfg[name]
        keys_of(TubesTask)[name].bounds.check(name, value)
    return cfg


def mixtures_in(job: ExportJob, candidates: Mixtures) -> Mixtures | None:
    """Find the mixtures of the strokes of a painting, from dark to light; None if one has a colour of no mixture."""
    colors = torch.unique(job.strokes.color.detach().cpu(), dim=0)
    if not len(colors):
        return None
    away, number = torch.cdist(colors.double(), candidates.color.double()).min(1)
    return candidates[number.unique().numpy()].from_dark() if bool((away < SAME).all()) else None
