"""Take over from a painting what decides how its strokes look."""

import logging
from collections.abc import Sequence
from copy import deepcopy
from pathlib import Path

from omegaconf import DictConfig, open_dict

from brushexp.config.rules import check_painting
from brushexp.errors import UserError
from brushexp.painting.reopen import export_job, recorded_settings
from brushexp.pictures.load import load_mask, size_of_picture
from brushexp.plugins.export.base import ExportJob
from brushexp.plugins.painter.base import Painter
from brushexp.registry import keep_built, plain_config, plugin_of, plugins
from brushexp.strokes.storage import load_catalogue
from brushexp_repaint.fence import Fence, room_in

log = logging.getLogger(__name__)
KEPT = ("blend", "color", "paper", "light")  # groups of keys whose values are those of the painting
FORCED = {"order": "fixed", "density": "fixed"}
OTHERS = ("renderer", "background", "resolution", "strokes", "warm_up", "wet")  # single keys that are, too
HALF = 0.5  # brightness from which a pixel of a mask counts


def saved_job(cfg: DictConfig) -> ExportJob:
    """Load the painting that is repainted; a UserError where there is none whose pixels could stay as they are."""
    if cfg.region is None:
        raise UserError("region= is missing; add region=mask.png, bright where the painting is to be repainted")
    if cfg.catalogue is None:
        raise UserError(f"region={cfg.region} is a part of a painting; add catalogue=outputs/<run>, the one to repaint")
    job = export_job(load_catalogue(Path(cfg.catalogue), "catalogue"))
    if job.saved.alpha is not None:
        cure = "paint it with background=mean, and repaint that"
        raise UserError(f"catalogue={cfg.catalogue} is transparent where its picture was, and region is not; {cure}")
    return job


def as_painted(cfg: DictConfig, job: ExportJob) -> DictConfig:
    """Return settings under which the strokes of a painting look as they did, in their order, on its ground."""
    saved, settings = job.saved, recorded_settings(job.saved)
    nodes = {name: settings[name] for name in KEPT if settings.get(name)}
    renderer = settings["renderer"] | {"_target_": _member("renderer", saved.renderer)}
    nodes |= {family: {"_target_": _member(family, name)} for family, name in FORCED.items()}
    ground = "#" + bytes((255 * saved.background).round().byte().tolist()).hex()
    values = {"background": ground, "resolution": max(saved.size), "strokes": None, "warm_up": None, "wet": 0}
    cfg = deepcopy(cfg)
    with open_dict(cfg):
        for name, value in (nodes | {"renderer": renderer} | values).items():
            cfg[name] = plain_config(value) if isinstance(value, dict) else value
    return cfg


def _member(family: str, name: str) -> str:
    return next(plugin.target for plugin in plugins(family) if plugin.name == name)


def fence_of(cfg: DictConfig, job: ExportJob) -> Fence:
    """Build the fence around the region; a UserError if nothing could be repainted in it."""
    mask = load_mask(cfg.region, job.size, "region") >= HALF
    if not mask.any():
        raise UserError(f"region={cfg.region} has no bright pixel; make white in it what is to be repainted")
    fence = Fence(job.strokes[job.bottom_up], room_in(mask, job), job.renderer.edge)
    if not fence.inner.any():
        cure = "make it larger, by a stroke's width and some 8 pixels on each side"
        raise UserError(f"region={cfg.region} holds no stroke of {cfg.catalogue} wholly; {cure}")
    return fence


def check_repainting(cfg: DictConfig, overrides: Sequence[str]) -> None:
    """Refuse what cannot be repainted, and tell of keys that have no say in it."""
    job = saved_job(cfg)
    fence_of(cfg, job)
    if isinstance(keep_built(cfg.painter), Painter):
        raise UserError(f"painter={plugin_of(cfg.painter).name} begins on a bare canvas; drop painter, or drop region")
    size = size_of_picture(cfg.image, "image", max(job.size))
    if size != job.size:
        height, width = job.size
        is_now = f"image={cfg.image} comes to {size[1]} x {size[0]} pixels, and the painting has {width} x {height}"
        raise UserError(f"{is_now}; give a picture whose sides have the same ratio")
    typed = {word.lstrip("+~").partition("=")[0].partition(".")[0] for word in overrides}
    forced = as_painted(cfg, job)
    if unused := sorted(typed & {*KEPT, *FORCED, *OTHERS}):
        log.warning("region=%s leaves %s as in the painting", cfg.region, ", ".join(unused))
    check_painting(forced, [word for word in overrides if not word.startswith("renderer=")], size)
