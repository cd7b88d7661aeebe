"""``task=tubes``: optimise strokes under what a table has."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from omegaconf import DictConfig
from torch import Tensor

from brushexp.painting.build import build_painter, target_of
from brushexp.painting.painting_module import PaintingModule
from brushexp.painting.stroke_optimizer import StrokeOptimizer
from brushexp.pictures.color import to_lab
from brushexp.pictures.colorimetry import decode_srgb, encode_srgb
from brushexp.runs.resume import restore_run
from brushexp.tasks.paint import paint_picture
from brushexp_tubes.constraint import Constraint
from brushexp_tubes.mixtures import Mixtures, all_mixtures, choose_mixtures
from brushexp_tubes.paints import load_tubes
from brushexp_tubes.table import StageOrder, Table

GREY = 5.0  # chroma in CIELAB up to which a mixture is grey
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear sRGB


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Paint, write everything into the run's folder, and return the figures of metrics.json."""
    cfg, checkpoint = restore_run(cfg)
    begun = None if checkpoint else start
    return paint_picture(cfg, folder, begun, checkpoint, build=build_constrained).metrics


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
    pixels_per_mm = target.shape[2] / (10 * cfg.width_cm)
    brushes = torch.tensor(sorted(set(cfg.brushes), reverse=True)) * pixels_per_mm
    return Table(choose_mixtures(candidates, target, cfg.mixtures), brushes, cfg.load)


def within_tones(picture: Tensor, mixtures: Mixtures) -> Tensor:
    """Map the luminance of a picture (3, H, W) to what lies between the darkest and the lightest grey of the mixtures.

    It is black point compensation, as printing has it (ISO 18619, 2015), with the white point likewise: linear in
    light, so that hues stay.
    """
    colors = mixtures.color.double().numpy()
    chroma = np.hypot(*to_lab(colors)[:, 1:].T)
    luminance = decode_srgb(colors)[chroma <= max(GREY, chroma.min())] @ LUMINANCE
    mapped = luminance.min() + np.ptp(luminance) * decode_srgb(picture.double().cpu().numpy())
    return torch.from_numpy(np.asarray(encode_srgb(mapped))).to(picture)
