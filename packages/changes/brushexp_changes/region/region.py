"""Repaint one region of a painting and leave the rest unchanged."""

from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from omegaconf import DictConfig, open_dict
from torch import Tensor

from brushexp.contracts import UserError, build_named, plain_config, plugins, register
from brushexp.contracts.families import Change, ExportJob, Order, PaintingState
from brushexp.contracts.painting import AUTO, export_job, recorded_settings, sizes_of, working_side_for
from brushexp.contracts.pictures import load_mask
from brushexp.contracts.strokes import Strokes, load_catalogue
from brushexp.contracts.tasks import PICTURE
from brushexp_changes.region.fence import Fence, room_in
from brushexp_changes.steps import check_steps

AS_PAINTED = ("blend", "color", "paper", "light")  # keys whose values are taken from the painting
MASK_THRESHOLD = 0.5  # brightness at which a pixel counts as inside the mask


@register("change", "region")
@dataclass(kw_only=True, eq=False)
class Region(Change):
    """Repaint one region of a painting; the rest stays bit-identical (as in ``region=mask.png catalogue=outputs/x``).

    Only strokes that are wholly inside the region move and change colour. The renderer, blend, colour space, paper,
    light, order and ground are taken from the painting. Strokes are optimised at the same size as before, unless
    ``working_resolution`` is set.

    Args:
        mask: picture with the painting's aspect ratio, bright where the painting should be repainted.
    """

    rank = 100  # this change runs last, so that no other change acts outside the region

    mask: Annotated[str, PICTURE] | None = None
    _job: ExportJob | None = field(default=None, init=False, repr=False)  # the painting
    _whole: Fence | None = field(default=None, init=False, repr=False)  # limits strokes at the size of the painting
    _fence: Fence | None = field(default=None, init=False, repr=False)  # limits strokes at the size of the target

    def settings(self, cfg: DictConfig) -> DictConfig:
        self._job = self._load(cfg)
        check_steps(cfg, f"region={self.mask}")
        return as_painted(cfg, self._job)

    def _load(self, cfg: DictConfig) -> ExportJob:
        if self.mask is None:
            raise UserError("change=region has no mask; type region=mask.png, bright in the area to repaint")
        if cfg.catalogue is None:
            cure = "add catalogue=outputs/<run>, the painting to repaint"
            raise UserError(f"region={self.mask} selects a part of a painting; {cure}")
        job = export_job(load_catalogue(Path(cfg.catalogue), "catalogue"))
        if job.saved.alpha is not None:
            cure = "paint it with background=mean, and repaint the result"
            wrong = f"catalogue={cfg.catalogue} is transparent where its picture was, but a region is opaque"
            raise UserError(f"{wrong}; {cure}")
        return job

    def check(self, cfg: DictConfig, size: tuple[int, int]) -> None:
        assert self._job is not None
        painting = sizes_of(cfg).painting
        if painting != self._job.size:
            height, width = self._job.size
            is_now = f"image={cfg.image} comes to {painting[1]} x {painting[0]} pixels"
            cure = "give a picture whose sides have the same ratio"
            raise UserError(f"{is_now}, and the painting has {width} x {height}; {cure}")
        if (wet := cfg.change.get("wet")) is not None and wet.amount:
            raise UserError(f"wet={wet.amount:g} drags paint out of region={self.mask}; drop wet")
        if not self._fence_of(self._job).inner.any():
            cure = "make it larger, by a stroke's width and some 8 pixels on each side"
            raise UserError(f"no stroke of {cfg.catalogue} lies wholly inside region={self.mask}; {cure}")

    def _fence_of(self, job: ExportJob) -> Fence:
        mask = load_mask(str(self.mask), job.size, "region") >= MASK_THRESHOLD
        if not mask.any():
            raise UserError(f"region={self.mask} has no bright pixel; paint the area to repaint white")
        return Fence(job.strokes[job.bottom_up], room_in(mask, job), job.renderer.edge)

    def ground(self, color: Tensor) -> Tensor:
        return color if self._job is None else self._job.saved.background.to(color)

    def order(self, order: Order) -> Order:
        if self._job is None:
            return order
        kept: Order = build_named("order", "fixed", {})
        return kept

    def begin(self, strokes: Strokes, state: PaintingState) -> Strokes:
        if self._job is None:
            return strokes
        self._whole = self._fence_of(self._job)
        first = self._whole.first().moved(zoom=1 / state.zoom)
        self._fence = Fence(first, self._whole.room, self._whole.edge, state.zoom)
        return self._fence(strokes)

    def limit(self, strokes: Strokes, before: Strokes | None, rows: Tensor | None, state: PaintingState) -> Strokes:
        if self._fence is None:
            return strokes
        return self._fence.to(strokes.position.device)(strokes, before, rows)

    def enlarge(self, strokes: Strokes) -> Strokes:
        return strokes if self._whole is None else self._whole(strokes)


def as_painted(cfg: DictConfig, job: ExportJob) -> DictConfig:
    """Return settings that render the strokes as in the existing painting, and that neither add nor remove strokes."""
    saved, recorded = job.saved, recorded_settings(job.saved)
    nodes: dict[str, Any] = {name: recorded[name] for name in AS_PAINTED if recorded.get(name)}
    nodes["renderer"] = recorded["renderer"] | {"_target_": _target_of("renderer", saved.renderer)}
    nodes |= {family: {"_target_": _target_of(family, "fixed")} for family in ("order", "density")}
    ground = "#" + bytes((255 * saved.background).round().byte().tolist()).hex()
    values = {"background": ground, "resolution": max(saved.size), "strokes": None, "warm_up": None}
    if cfg.working_resolution == AUTO:
        values["working_resolution"] = working_resolution_of(job)
    cfg = deepcopy(cfg)
    with open_dict(cfg):
        for name, node in nodes.items():
            cfg[name] = plain_config(node)
        for name, value in values.items():
            cfg[name] = value
    return cfg


def working_resolution_of(job: ExportJob) -> str | None:
    """Return the ``working_resolution`` at which a painting was optimised; None means the painting's own size."""
    recorded = recorded_settings(job.saved)
    side = recorded.get("working_resolution")
    if side == AUTO and recorded.get("resolution") is None:
        return str(working_side_for(len(job.strokes), job.size))
    return str(side) if str(side).isdecimal() else None


def _target_of(family: str, name: str) -> str:
    return next(plugin.target for plugin in plugins(family) if plugin.name == name)
