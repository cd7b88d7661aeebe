"""``task=tubes``: optimise strokes, which are kept to what a table has."""

from dataclasses import replace
from pathlib import Path

import torch
from omegaconf import DictConfig
from torch import Tensor

from brushexp.painting.build import build_painter, target_of
from brushexp.painting.painting_module import PaintingModule
from brushexp.painting.stroke_optimizer import StrokeOptimizer
from brushexp.plugins.order.base import front_to_back
from brushexp.runs.resume import restore_run
from brushexp.strokes.catalogue import Strokes
from brushexp.tasks.paint import paint_into
from brushexp_tubes.mixtures import Mixtures, all_mixtures, choose_mixtures, within_tones
from brushexp_tubes.paints import load_tubes
from brushexp_tubes.table import StageOrder, Table

FREE = 0.4  # share of the steps in which colours are free
UNTIL = 0.9  # share of the steps after which each stroke keeps its mixture
EVERY = 10  # steps between two choices of mixtures
AGAIN = 3  # times that mixtures are chosen in each, since those of other strokes have changed meanwhile
SEEN = 0.5  # pixels: a stroke that is seen less keeps its mixture


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Paint, write everything into the run's folder, and return the figures of metrics.json."""
    cfg, checkpoint = restore_run(cfg)
    begun = None if checkpoint else start
    return paint_into(folder, cfg, begun, checkpoint, build=build_constrained).metrics


@torch.no_grad()
def build_constrained(cfg: DictConfig) -> PaintingModule:
    """Build the painter of a checked config, whose strokes stay within what the table has."""
    picture, candidates = target_of(cfg), all_mixtures(load_tubes(cfg.tubes))
    target = within_tones(picture, candidates)
    table = table_for(cfg, target, candidates)
    painter = build_painter(cfg, target)
    assert isinstance(painter, StrokeOptimizer)
    painter.limit = Constraint(painter, table)
    order = StageOrder(table)
    painter.components, painter.depth.order = replace(painter.components, order=order), order
    painter.catalogue.replace(table.dealt(painter.catalogue()))
    painter.depth.renew(painter.strokes())
    return painter


def table_for(cfg: DictConfig, target: Tensor, candidates: Mixtures) -> Table:
    """Choose the mixtures for a target (3, H, W), and scale the brushes to it."""
    return table_with(cfg, choose_mixtures(candidates, target, cfg.mixtures), target.shape[2])


def table_with(cfg: DictConfig, mixtures: Mixtures, width: int) -> Table:
    """Make a table with mixtures, and the brushes of a config scaled to a picture so many pixels wide."""
    brushes = torch.tensor(sorted(set(cfg.brushes), reverse=True)) * width / (10 * cfg.width_cm)
    return Table(mixtures, brushes, cfg.load)


class Constraint:
    """A limit of the strokes of a painter: widths are those of brushes, and later colours those of mixtures.

    From the beginning strokes are opaque and have widths of brushes. After the share ``FREE`` of the steps each stroke
    has a mixture, which is chosen anew every few steps, and meanwhile stays, while place, length and bend move on.
    """

    def __init__(self, painter: StrokeOptimizer, table: Table) -> None:
        self.painter, self.table = painter, table

    @torch.no_grad()
    def __call__(self, strokes: Strokes, before: Strokes | None = None, rows: Tensor | None = None) -> Strokes:
        """Bring strokes to what they may be; after a step they were ``before``, and are number ``rows`` of all."""
        strokes, progress = self.table.sized(strokes), self.progress
        if progress < FREE and not self.painter.stop:
            return strokes
        if before is None or rows is not None:
            return self.table.mixed(strokes)
        strokes = replace(strokes, color=before.color)
        if progress <= UNTIL and self.painter.schedule.step % EVERY == 0:
            return self.assigned(strokes)
        return self.table.mixed(strokes)

    @property
    def progress(self) -> float:
        """Share of all steps that are done, 0 to 1."""
        schedule = self.painter.schedule
        return schedule.step / schedule.steps if schedule.steps else 1.0

    def assigned(self, strokes: Strokes) -> Strokes:
        """Choose for each of N strokes the mixture nearest to the colour by which the squared error falls most.

        The picture is linear in the colours, sum_k w_k c_k with shares w_k of at most 1 in all. So with the error e of
        a picture, c_k + sum(w_k e) / sum(w_k), sums over pixels, is the minimum of a function of each colour alone that
        lies above the squared error of all (a majoriser): all strokes can go there at once.
        """
        for _ in range(AGAIN):
            strokes = self.table.mixed(replace(strokes, color=wanted_colors(self.painter, strokes)))
        return strokes


def wanted_colors(painter: StrokeOptimizer, strokes: Strokes) -> Tensor:
    """Compute the colours (N, 3) at which the majoriser of `Constraint.assigned` is least."""
    picture, order = painter.picture, front_to_back(painter.components.order.depth(strokes, None))
    color = strokes.color.clone().requires_grad_()
    with torch.enable_grad():
        layers = picture.renderer(replace(strokes, color=color))
        image = picture.blend(layers, order, picture.size, picture.background).image
    if not image.requires_grad:
        return strokes.color
    error = picture.target - image.detach()
    weight = torch.ones_like(image) if picture.focus is None else picture.focus.expand_as(image)
    (gain,) = torch.autograd.grad(image, color, weight * error, retain_graph=True)
    (seen,) = torch.autograd.grad(image, color, weight)
    return torch.where(seen > SEEN, strokes.color + gain / seen.clamp_min(SEEN), strokes.color).clamp(0, 1)
