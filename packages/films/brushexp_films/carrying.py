"""Carry strokes from one picture of a film to the next: adapt strokes where the film changes, and keep all others."""

import logging
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import torch
from torch import Tensor

from brushexp.contracts.families import DensificationState, Renderer, View, restore, state_of, weighted_sum
from brushexp.contracts.members import new_strokes
from brushexp.contracts.painting import Components, Picture, boxes_of, importance
from brushexp.contracts.pictures import Region
from brushexp.contracts.strokes import Catalogue, Strokes, curve_of, half_width_of, point_at
from brushexp_films.changes import Changes, optical_flow

log = logging.getLogger(__name__)
ALONG, ACROSS = 12, (-0.6, 0.0, 0.6)  # points along and across a stroke at which changes are looked up
CHANGED_SHARE = 0.5  # share of a stroke in changed areas above which it moves; otherwise its side effects would show
MOVED_SHARE = 0.05  # share of the moving strokes that are laid elsewhere, in addition to harmful strokes
NEW_STROKE_SIZE = 0.5  # size of replaced strokes, in stroke spacings
TOLERANCE = 0.03  # acceptable root mean square error, 0 to 1
SHAPE = ("start", "control", "end")


@dataclass(frozen=True)
class Cel:
    """The strokes of one picture of a film; their number, row indices and brushes are constant within a scene."""

    strokes: Strokes  # N strokes
    front_to_back: Tensor  # (N,) stroke numbers, top to bottom
    background: Tensor  # (3,) RGB of the bare canvas


@dataclass(frozen=True)
class Carrier:
    """Carries the strokes of a picture to the next picture in a few gradient steps.

    Where the film changes, strokes follow its motion and are then optimised for the painting's losses. The
    harmful and the least important of these are replaced by smaller strokes on top, where the error is largest; each
    new stroke takes the row index and the brush of the stroke that it replaces. All other strokes stay bit-identical
    and keep their order, so that nothing appears suddenly.
    """

    components: Components
    renderer: Renderer
    steps: int
    seed: int = 0  # seed for estimating the importance of strokes

    @cached_property
    def unused(self) -> dict[str, Any]:
        """State of the losses before they have compared any picture."""
        return state_of(self.components.losses)

    def __call__(self, cel: Cel, painted: Tensor, target: Tensor, changed: Tensor, motion: Tensor) -> Cel:
        """Return the strokes for the next ``target`` (3, H, W), which has changed where ``changed`` (H, W) is true.

        ``painted`` (3, H, W) is the previous painting; ``motion`` (2, H, W) is the displacement of each pixel since the
        previous target.
        """
        size = (target.shape[1], target.shape[2])
        moves = shares_within(cel.strokes, changed) >= CHANGED_SHARE
        cel = replace(cel, strokes=advect(cel.strokes, moves, motion * changed))
        moves |= shares_within(cel.strokes, changed) >= CHANGED_SHARE
        low, high = boxes_of(cel.strokes, self.renderer.edge)
        region = region_around(low[moves], high[moves], size)
        if region is None:
            return cel
        cel = self._relaid(cel, target, changed, moves, region)
        return replace(cel, strokes=self._optimise(cel, painted, target, moves, region))

    def _relaid(self, cel: Cel, target: Tensor, changed: Tensor, moves: Tensor, region: Region) -> Cel:
        """Replace the harmful and the least important moving strokes with new strokes where the error is largest."""
        number = find_strokes(cel.strokes, region, self.renderer.edge)
        picture = self.picture(region.of(target).contiguous(), cel.background)
        strokes = cel.strokes[number].moved(shift=(-region.left, -region.top))
        order = cel.front_to_back.argsort()[number].argsort()
        movable = moves[number]
        with torch.no_grad():
            layers = self.renderer(strokes)
            image = self.components.blend(layers, order, picture.size, cel.background).image
        generator = torch.Generator().manual_seed(self.seed)
        matter = importance(strokes, order, picture, generator).where(movable, torch.inf)
        harmful = int((matter <= 3 * TOLERANCE**2).sum())
        count = min(int(movable.sum()), harmful + round(MOVED_SHARE * int(movable.sum())))
        budget = max(1, round(len(moves) * picture.target[0].numel() / target[0].numel()))  # same density as the whole
        pictures = (image, picture.target, region.of(changed).to(image))
        state = DensificationState(*pictures, strokes, budget, 0, 0, lambda: matter)
        new = new_strokes(state, count, NEW_STROKE_SIZE, TOLERANCE).moved(shift=(region.left, region.top))
        removed = number[matter.argsort(stable=True)[: len(new)]]
        new = self.renderer.convert(with_paint_of(new, cel.strokes[removed], self.components.optimizer.units))
        above = torch.zeros_like(moves)
        above[removed] = True
        front_to_back = torch.cat([removed, cel.front_to_back[~above[cel.front_to_back]]])
        return replace(cel, strokes=cel.strokes.with_rows(removed, new), front_to_back=front_to_back)

    def _optimise(self, cel: Cel, painted: Tensor, target: Tensor, moves: Tensor, region: Region) -> Strokes:
        """Optimise the moving strokes by gradient steps; the strokes around them are drawn but stay fixed."""
        active, around = moves.nonzero()[:, 0], torch.zeros_like(moves)
        around[find_strokes(cel.strokes, region, self.renderer.edge)] = True
        view = View(region, active, (around & ~moves).nonzero()[:, 0])
        picture = self.picture(target, cel.background)
        picture.memory = picture.memory_of(painted.clone())
        catalogue, chosen = Catalogue(cel.strokes[active], self.components.optimizer.units), self.components.optimizer
        optimizer = chosen.over(value for value in catalogue.parameters() if value.requires_grad)
        rates = [group["lr"] for group in optimizer.param_groups]
        restore(self.components.losses, self.unused)  # strokes may depend only on those of the previous picture
        best = cel.strokes

        def closure() -> float:
            optimizer.zero_grad()
            catalogue.keep_in_range()
            _, view_of = picture.see(catalogue(), cel.strokes, view, cel.front_to_back, accuracy=False)
            total, _ = weighted_sum(self.components.losses, view_of)
            if total.requires_grad:
                total.backward()
            return float(total.detach())

        for step in range(self.steps):
            for group, rate in zip(optimizer.param_groups, rates, strict=True):
                group["lr"] = rate * chosen.share(step / self.steps)
            if not math.isfinite(optimizer.step(closure)) or not catalogue.is_finite():
                log.warning("a step gave invalid numbers; the strokes stay as they were before it")
                break
            catalogue.keep_in_range()
            moved = catalogue()
            clamped = self.renderer.clamp(moved)
            if clamped is not moved:
                catalogue.replace(clamped)
            best = cel.strokes.with_rows(active, clamped.map(Tensor.detach))
        return best

    def picture(self, target: Tensor, background: Tensor) -> Picture:
        """Make a canvas on which strokes are optimised towards ``target`` (3, H, W)."""
        picture = Picture(target, None, background, self.components.blend)
        picture.renderer = self.renderer
        return picture


class Reel:
    """State of a film being painted, which depends only on the film and on the last picture's strokes (`follow`)."""

    cel: Cel  # strokes of the last picture

    def __init__(self, begin: Callable[[Tensor], Cel], carrier: Carrier, threshold: float) -> None:
        self.begin = begin  # function that paints the first picture (3, H, W) of a scene
        self.carrier = carrier
        self.changes = Changes(threshold)
        self.image = torch.empty(0)  # (3, H, W), the last painting, without light
        self.scenes = 0

    def paint(self, picture: Tensor) -> None:
        """Paint the next picture (3, H, W), in [0, 1]."""
        before = self.changes.held
        changed = self._see(picture)
        if self.changes.begins:
            self.show(self.begin(picture))
        elif changed.any():
            held = self.changes.held
            self.show(self.carrier(self.cel, self.image, held, changed, optical_flow(before, held)))

    def follow(self, picture: Tensor, cel: Cel) -> None:
        """Adopt the strokes of the next picture, which has already been painted."""
        self._see(picture)
        self.show(cel)

    def _see(self, picture: Tensor) -> Tensor:
        changed = self.changes(picture)
        self.scenes += self.changes.begins
        return changed

    def show(self, cel: Cel) -> None:
        """Draw a picture's strokes, and store them with their painting as the last picture."""
        canvas = self.carrier.picture(self.changes.held, cel.background)
        self.cel, self.image = cel, canvas.draw(cel.strokes, cel.front_to_back)


@torch.no_grad()
def shares_within(strokes: Strokes, mask: Tensor) -> Tensor:
    """Estimate, from sample points, the fraction (N,) of each stroke that is inside a mask (H, W)."""
    curve, half = curve_of(strokes), half_width_of(strokes)
    chord = curve[:, 2] - curve[:, 0]
    normal = torch.stack([-chord[:, 1], chord[:, 0]], 1) / chord.norm(dim=1, keepdim=True).clamp_min(1e-6)
    aside = normal[:, None] * (half[:, None] * half.new_tensor(ACROSS))[..., None]  # (N, 3, 2)
    points = (spine_of(strokes)[:, :, None] + aside[:, None]).flatten(1, 2)
    inside = ((points >= 0) & (points < points.new_tensor([mask.shape[1], mask.shape[0]]))).all(2)
    return (at(mask, points) & inside).float().mean(1)


@torch.no_grad()
def advect(strokes: Strokes, which: Tensor, motion: Tensor) -> Strokes:
    """Move the strokes where ``which`` (N,) is true by the median of ``motion`` (2, H, W) along their curves."""
    median = at(motion, spine_of(strokes)).median(2).values.T
    return replace(strokes, position=torch.where(which[:, None], strokes.position + median, strokes.position))


def spine_of(strokes: Strokes) -> Tensor:
    """Sample `ALONG` points on each stroke's curve, (N, ALONG, 2)."""
    return point_at(curve_of(strokes)[:, None], torch.linspace(0, 1, ALONG, device=strokes.position.device))


def at(picture: Tensor, points: Tensor) -> Tensor:
    """Look up the values (..., N, P) of a picture (..., H, W) at the pixels nearest to points (N, P, 2)."""
    column, row = (points[..., k].clamp(0, picture.shape[-1 - k] - 1).long() for k in (0, 1))
    return picture[..., row, column]


def region_around(low: Tensor, high: Tensor, size: tuple[int, int]) -> Region | None:
    """Return the region of a canvas that encloses all boxes from ``low`` to ``high`` (N, 2), or None if it is empty."""
    if not len(low):
        return None
    left, top = (max(0, int(x)) for x in low.amin(0).floor().tolist())
    right, bottom = (min(side, int(x)) for side, x in zip(size[::-1], high.amax(0).ceil().tolist(), strict=True))
    return Region(top, left, bottom - top, right - left) if right > left and bottom > top else None


def find_strokes(strokes: Strokes, region: Region, edge: float) -> Tensor:
    """Return the indices (n,) of the strokes whose bounding boxes overlap a region."""
    low, high = boxes_of(strokes, edge)
    corner = low.new_tensor([region.left, region.top])
    return ((high > corner) & (low < corner + low.new_tensor([region.width, region.height]))).all(1).nonzero()[:, 0]


def with_paint_of(new: Strokes, old: Strokes, units: Mapping[str, float]) -> Strokes:
    """Give ``new`` strokes the opacity of the ``old`` ones, and their colour and shape if these are not optimised."""
    fields = {"opacity"} | ({"color"} if not units.get("color") else set())
    if not any(units.get(name) for name in SHAPE):
        fields |= {"scale", "width", *SHAPE}
    return replace(new, **{name: getattr(old, name) for name in fields})
