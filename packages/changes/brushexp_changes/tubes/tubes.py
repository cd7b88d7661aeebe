"""Paint with mixtures of given tubes and with brushes of given widths."""

from copy import deepcopy
from dataclasses import dataclass, field, replace
from math import ceil
from typing import Annotated

import torch
from omegaconf import DictConfig
from torch import Tensor

from brushexp.contracts import Rule, UserError, above, between, keep_built, plugin_of, register
from brushexp.contracts.families import Change, Order, PaintingState
from brushexp.contracts.members import Rgb
from brushexp.contracts.painting import sizes_of
from brushexp.contracts.strokes import Strokes
from brushexp_changes.steps import check_steps
from brushexp_changes.tubes.mixtures import Mixtures, all_mixtures, choose_mixtures, map_tones
from brushexp_changes.tubes.paints import load_tubes
from brushexp_changes.tubes.table import StageOrder, Table

FREE_COLOR_SHARE = 0.4  # share of the steps during which colours are free
LAST_CHOICE = 0.9  # share of the steps after which each stroke keeps its mixture
STEPS_BETWEEN_CHOICES = 10  # steps between two choices of mixtures
CHOICES_AT_ONCE = 3  # iterations per choice, because the mixtures of other strokes change meanwhile
LEAST_SEEN = 0.5  # visible area in pixels below which a stroke keeps its mixture
MM_PER_CM = 10
AUTO = "auto"  # value of working_resolution that depends on the number of strokes


@register("change", "tubes")
@dataclass(kw_only=True, eq=False)
class OfTubes(Change):
    """Paint with given tubes and brushes, for painting by hand (as in ``tubes=zorn brushes=[25,12,6] width_cm=40``).

    From the beginning, strokes are opaque, as wide as one of the brushes, and no longer than a load of paint lasts.
    After two fifths of the steps, each stroke gets the colour of a mixture. Mixtures are reassigned every few steps,
    while position, length and bend are still optimised. Strokes of large brushes are below strokes of small brushes;
    among the strokes of each brush, dark mixtures are below light mixtures.

    Args:
        tubes: set of tubes to paint with: eight, acrylics, primaries, zorn, or a CSV file.
        mixtures: maximum number of mixtures, each of up to three tubes.
        brushes: widths of the brushes in mm.
        width_cm: width of the painting in cm.
        load: length that a brush paints with one load, in brush widths.
    """

    tubes: Annotated[str, Rule(load_tubes)] = "eight"
    mixtures: Annotated[int, between(1, 200)] = 24
    brushes: Annotated[tuple[float, ...], between(0.5, 200)] = (25.0, 12.0, 6.0)
    width_cm: Annotated[float, above(0, 2000)] = 30.0
    load: Annotated[float, between(1, 1000)] = 12.0
    _table: Table | None = field(default=None, init=False, repr=False)  # set once the target is known

    def settings(self, cfg: DictConfig) -> DictConfig:
        """Enlarge the working picture until the thinnest brush is one pixel wide, if the photograph is large enough."""
        if cfg.working_resolution != AUTO or cfg.resolution is not None or not self.brushes:
            return cfg
        sizes = sizes_of(cfg)
        thin = min(self.brushes) * sizes.working[1] / (MM_PER_CM * self.width_cm)
        if thin >= 1 or thin * sizes.zoom < 1:
            return cfg
        cfg = deepcopy(cfg)
        cfg.working_resolution = str(ceil(max(sizes.working) / thin))
        return cfg

    def check(self, cfg: DictConfig, size: tuple[int, int]) -> None:
        check_steps(cfg, f"tubes={self.tubes}")
        if not self.brushes:
            raise UserError("brushes=[] leaves nothing to paint with; give widths in mm, 'brushes=[25,12,6]'")
        if (wet := cfg.change.get("wet")) is not None and wet.amount:
            raise UserError(f"wet={wet.amount:g} drags colours that no mixture has; drop wet, or drop tubes")
        if not isinstance(keep_built(cfg.color), Rgb):
            wrong = f"color={plugin_of(cfg.color).name} is for glazes, but paint of tubes= is opaque"
            raise UserError(f"{wrong}; drop color")
        thinnest = min(self.brushes)
        if (thin := thinnest * size[1] / (MM_PER_CM * self.width_cm)) < 1:
            cure = f"set resolution={round(max(size) / thin) + 1}, or leave that brush out"
            raise UserError(f"a brush of {thinnest:g} mm is {thin:.2g} pixels wide; {cure}")

    def target(self, picture: Tensor) -> Tensor:
        candidates = all_mixtures(load_tubes(self.tubes))
        toned = map_tones(picture, candidates)
        self._table = self.table_for(toned, candidates)
        return toned

    def table_for(self, target: Tensor, candidates: Mixtures) -> Table:
        """Make a table for a target (3, H, W): choose mixtures for it, and scale the brushes to its size."""
        return self.table_of(choose_mixtures(candidates, target, self.mixtures), target.shape[2])

    def table_of(self, mixtures: Mixtures, width: int) -> Table:
        """Make a table of the given mixtures, with brushes scaled to a picture ``width`` pixels wide."""
        brushes = torch.tensor(sorted(set(self.brushes), reverse=True)) * width / (MM_PER_CM * self.width_cm)
        return Table(mixtures, brushes, self.load)

    def order(self, order: Order) -> Order:
        return order if self._table is None else StageOrder(self._table)

    def begin(self, strokes: Strokes, state: PaintingState) -> Strokes:
        return strokes if self._table is None else self._table.deal(strokes)

    @torch.no_grad()
    def limit(self, strokes: Strokes, before: Strokes | None, rows: Tensor | None, state: PaintingState) -> Strokes:
        if self._table is None:
            return strokes
        strokes = self._table.with_brushes(strokes)
        if state.progress < FREE_COLOR_SHARE and not state.is_over:
            return strokes
        if before is None or rows is not None:
            return self._table.with_mixtures(strokes)
        strokes = replace(strokes, color=before.color)
        if state.progress <= LAST_CHOICE and state.step % STEPS_BETWEEN_CHOICES == 0:
            return reassign_mixtures(strokes, self._table, state)
        return self._table.with_mixtures(strokes)


def reassign_mixtures(strokes: Strokes, table: Table, state: PaintingState) -> Strokes:
    """Choose, for each of N strokes, the mixture nearest to the colour that reduces the squared error most.

    The picture is linear in the colours: sum_k w_k c_k, with weights w_k that sum to at most 1. With the picture's
    error e, the colour c_k + sum(w_k e) / sum(w_k), summed over pixels, minimises a separable upper bound on the
    squared error (a majoriser), so all strokes can be moved to their minima at once.
    """
    for _ in range(CHOICES_AT_ONCE):
        strokes = table.with_mixtures(replace(strokes, color=best_colors(strokes, state)))
    return strokes


def best_colors(strokes: Strokes, state: PaintingState) -> Tensor:
    """Compute the colours (N, 3) that minimise the majoriser of `reassign_mixtures`."""
    order = state.order(strokes)
    color = strokes.color.clone().requires_grad_()
    with torch.enable_grad():
        layers = state.renderer(replace(strokes, color=color))
        image = state.blend(layers, order, state.size, state.ground).image
    if not image.requires_grad:
        return strokes.color
    error = state.target - image.detach()
    weight = torch.ones_like(image) if state.focus is None else state.focus.expand_as(image)
    (gain,) = torch.autograd.grad(image, color, weight * error, retain_graph=True)
    (seen,) = torch.autograd.grad(image, color, weight)
    return torch.where(seen > LEAST_SEEN, strokes.color + gain / seen.clamp_min(LEAST_SEEN), strokes.color).clamp(0, 1)
