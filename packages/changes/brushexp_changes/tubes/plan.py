"""Plan strokes and dips in stages with one brush and one mixture each; play plans back; label areas by mixture."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from brushexp.contracts.families import ExportJob
from brushexp.contracts.results import measure_strokes
from brushexp.contracts.strokes import Strokes, curve_of, length_of, truncate
from brushexp_changes.tubes.table import Table

FULL = 0.6  # share of a load at which a brush begins to run dry
DRIEST = 0.4  # coverage at the end of a load
FILMS = 4  # number of films that make up a stroke of a brush that runs dry, each shorter than the one below
NUMBERED = 300  # pixels on the longer side of the paint-by-numbers drawing
TOUCHING = np.ones((3, 3), dtype=int)  # connectivity of parts: pixels that touch at sides or corners belong together
ROWS = 16  # strips in which the strokes of a stage are painted, back and forth

Array = np.ndarray


@dataclass(frozen=True)
class Stage:
    """Strokes ``first`` to ``last`` (exclusive) of a plan, painted with one brush and one mixture."""

    number: int  # from 1
    brush_mm: float
    mixture: int  # from 0
    first: int
    last: int
    dips: int
    metres: float


@dataclass(frozen=True, eq=False)
class Plan:
    """N strokes in painting order, with their paints and brushes."""

    job: ExportJob  # its strokes have the mixtures' colours and the brushes' widths
    table: Table
    order: Tensor  # (N,) numbers of strokes in painting order
    pixels_per_mm: float

    @cached_property
    def brushes_mm(self) -> list[float]:
        """Widths of the brushes in mm, from large to small."""
        return [round(float(width) / self.pixels_per_mm, 3) for width in self.table.brushes]

    @cached_property
    def strokes(self) -> Strokes:
        """Strokes in painting order."""
        return self.job.strokes[self.order]

    @cached_property
    def stage(self) -> Tensor:
        """Stage (N,) of each stroke, in non-decreasing order."""
        return self.table.stage_of(self.strokes)

    @cached_property
    def _lengths(self) -> tuple[Array, Array]:
        """Length (N,) of each stroke, and length (N,) that its brush paints with one load, in pixels."""
        strokes = self.strokes
        load = self.table.load * self.table.brushes.double()[self.table.brush_of(strokes)]
        return length_of(curve_of(strokes)).double().numpy(), load.numpy()

    @cached_property
    def used(self) -> Array:
        """Length (N,) painted since the last dip, in pixels, at the beginning of each stroke; 0 right after a dip.

        A brush is dipped at the beginning of a stage, and whenever its load would not last for the next stroke.
        """
        used, before, stage = np.zeros(len(self.order)), 0.0, -1
        for k, (length, load, its) in enumerate(zip(*self._lengths, self.stage.tolist(), strict=True)):
            before = 0.0 if its != stage or before + length > load else before
            used[k], before, stage = before, before + length, its
        return used

    @cached_property
    def coverage(self) -> Array:
        """Coverage (N, 2) at the beginning and at the end of each stroke, between ``DRIEST`` and 1."""
        length, load = self._lengths
        spent = np.stack([self.used, self.used + length], axis=1) / load[:, None]
        return 1 - (1 - DRIEST) * ((spent - FULL) / (1 - FULL)).clip(0, 1)

    @cached_property
    def stages(self) -> list[Stage]:
        """Non-empty stages, in painting order."""
        numbers, first, counts = np.unique(self.stage.numpy(), return_index=True, return_counts=True)
        stages = []
        for k, (stage, begin, end) in enumerate(zip(numbers, first, first + counts, strict=True)):
            brush, mixture = divmod(int(stage), len(self.table.mixtures))
            dips = int((self.used[begin:end] == 0).sum())
            metres = self._lengths[0][begin:end].sum() / self.pixels_per_mm / 1000
            stages.append(Stage(k + 1, self.brushes_mm[brush], mixture, int(begin), int(end), dips, metres))
        return stages

    @property
    def dips(self) -> int:
        return sum(stage.dips for stage in self.stages)

    @property
    def metres(self) -> float:
        """Total length of all strokes in metres."""
        return sum(stage.metres for stage in self.stages)

    def drop_hidden(self, least_visible: float) -> "Plan":
        """Omit strokes whose visible fraction in the finished painting is below ``least_visible``."""
        if len(self.order) < 2 or not least_visible:
            return self
        measures = measure_strokes(self.strokes, torch.arange(len(self.order), dtype=torch.int32), self.job.size)
        seen = torch.from_numpy(np.asarray(measures.visible) >= least_visible)
        return Plan(self.job, self.table, self.order[seen], self.pixels_per_mm)

    def after(self, strokes: int) -> ExportJob:
        """Return the painting after the first ``strokes`` strokes of the plan."""
        begun = Plan(self.job, self.table, self.order[:strokes], self.pixels_per_mm)
        return begun.play_back()

    def play_back(self) -> ExportJob:
        """Return the painting that results from following the plan, with brushes that run dry.

        A stroke whose brush runs dry becomes a stack of films: copies of the stroke, each shorter than the one below.
        """
        strokes = self.strokes
        start, end = torch.from_numpy(self.coverage).to(strokes.opacity).unbind(1)
        parts, height = [], []
        for k in range(FILMS):
            goal, below = (end + (start - end) * (k + share) / FILMS for share in (1, 0))
            dry = torch.arange(len(strokes)) if k == 0 else (start - end > 1e-3).nonzero()[:, 0]
            opacity = goal if k == 0 else 1 - (1 - goal) / (1 - below).clamp_min(1e-6)
            film = truncate(strokes[dry], torch.full_like(start[dry], 1 - k / FILMS))
            parts.append(replace(film, opacity=opacity[dry].clamp(0, 1)))
            height.append(dry * FILMS + k)
        films = replace(Strokes.join(*parts), brush=torch.cat([part.brush for part in parts]))
        saved, front_to_back = self.job.saved, torch.cat(height).argsort(descending=True)
        return replace(self.job, saved=saved.with_strokes(films, front_to_back, saved.background)).bare()


def plan_of(job: ExportJob, table: Table, pixels_per_mm: float) -> Plan:
    """Plan a painting: adapt its strokes to the table, and order them by stage and then back and forth in strips."""
    strokes = table.with_mixtures(table.with_brushes(job.strokes.map(lambda value: value.detach().cpu())))
    job = replace(job, saved=replace(job.saved, strokes=strokes))
    x, y = curve_of(strokes)[:, 0].T.double().numpy()
    strip = np.floor(y / job.size[0] * ROWS)
    along = np.where(strip % 2, -x, x)
    order = np.lexsort((along, strip, table.stage_of(strokes).numpy()))
    return Plan(job, table, torch.from_numpy(order), pixels_per_mm)


def numbered_regions(plan: Plan, smallest_mm: float = 0.0) -> Array:
    """Label each pixel (h, w) of the finished plan with its mixture, counted from 0, without slivers and spots.

    Areas narrower than ``smallest_mm`` or the smallest brush, whichever is larger, cannot be painted by hand, nor can
    parts smaller than a square of that width. Both are merged with their neighbours.
    """
    small = plan.play_back().at_most(NUMBERED)
    colors = torch.from_numpy(small.picture()).double() / 255
    mixtures = plan.table.mixtures
    if not len(mixtures):
        return np.zeros(small.size, dtype=int)
    away = torch.cdist(colors.reshape(-1, 3), mixtures.color.double())
    regions = away.argmin(1).reshape(small.size).numpy()
    zoom = small.size[1] / plan.job.size[1]
    side = max(float(plan.table.brushes.min()), smallest_mm * plan.pixels_per_mm) * zoom
    return merge_slivers(regions, side)


def merge_slivers(regions: Array, side: float) -> Array:
    """Merge areas narrower than ``side``, and parts smaller than ``side`` squared, with their neighbours.

    An area is narrow if a morphological opening with a disc removes it (Serra, 1982). Removed pixels are assigned the
    number of the nearest remaining pixel, so the remaining parts only grow.
    """
    from scipy.ndimage import distance_transform_edt, label  # noqa: PLC0415  (slow to import)

    stays = np.zeros(regions.shape, dtype=bool)
    for number in np.unique(regions):
        mask = regions == number
        core = distance_transform_edt(np.pad(mask, 1, mode="edge"))[1:-1, 1:-1] >= side / 2
        opened = mask & (distance_transform_edt(~core) <= side / 2) if core.any() else core
        parts, _ = label(opened, structure=TOUCHING)
        stays |= opened & (np.bincount(parts.ravel())[parts] >= side**2)
    if not stays.any():
        return regions
    nearest = distance_transform_edt(~stays, return_distances=False, return_indices=True)
    return regions[tuple(nearest)]


def labels_of(mask: Array) -> Iterator[tuple[int, int, float]]:
    """Yield, for each part of a mask (h, w), where to write its number (row, column) and the distance to its edge."""
    from scipy.ndimage import distance_transform_edt, label, maximum_position  # noqa: PLC0415  (slow to import)

    parts, count = label(mask)
    depth = distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1]
    for row, column in maximum_position(depth, parts, range(1, count + 1)):
        yield int(row), int(column), float(depth[int(row), int(column)])
