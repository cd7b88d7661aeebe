"""From the config of a painting to a painter before its first step."""

from dataclasses import dataclass

from omegaconf import DictConfig
from torch import Tensor

from brushexp.painting.assembly import budget_of, components_of, first_strokes, focus_of, in_colors, paced
from brushexp.painting.painter import Painter
from brushexp.painting.painting_module import PaintingModule
from brushexp.painting.procedure import Procedure
from brushexp.pictures.load import background_color, load_picture
from brushexp.plugins.painter.base import PaintingMethod
from brushexp.registry import take_built
from brushexp.strokes.catalogue import Catalogue


@dataclass(frozen=True)
class Prepared:
    """A painting before its first step, and the pictures (3, H, W) that it paints from, by the names of their files."""

    painter: PaintingModule
    pictures: dict[str, Tensor]  # target, and style and focus where there are such


def prepared(cfg: DictConfig, target: Tensor | None = None) -> Prepared:
    """Build what a checked config of ``task=paint`` names, on the CPU; PyTorch's generators are to be seeded before.

    ``target`` (3, H, W) in [0, 1] takes the place of the picture that ``image`` names, at its own size.
    """
    target = load_picture(cfg.image, cfg.resolution) if target is None else target
    size = (target.shape[1], target.shape[2])
    method: PaintingMethod = take_built(cfg.painter)
    if not method.by_steps:
        parts, background = components_of(cfg), background_color(cfg.background, target)
        n = budget_of(cfg, size, parts.density)
        return Prepared(Procedure(method, parts, target, background, n=n, seed=cfg.seed), {"target": target})
    pictures: dict[str, Tensor] = {}
    focus, attended = focus_of(cfg, target)
    if attended is not None:
        pictures["focus"] = attended.expand(3, -1, -1)
    parts = components_of(cfg)
    if cfg.style.image is not None:
        target, pictures["style"] = in_colors(target, parts)
    background = background_color(cfg.background, target)
    pictures = {"target": target} | pictures
    strokes, budget = first_strokes(cfg, target, parts.density, focus)
    parts = paced(parts, cfg.steps_per_stroke, strokes, size)
    catalogue = Catalogue(strokes, parts.optimizer.units)
    painter = Painter(
        catalogue, parts, target, background, seed=cfg.seed, focus=focus, budget=budget, coarse=cfg.coarse
    )
    return Prepared(painter, pictures)
