"""Painting a part of the canvas, with the rest as it was last seen."""

import torch
from torch import Tensor

from brushexp.compositing.layers import EDGE, SPREAD
from brushexp.painting.patch_cache import PatchCache
from brushexp.pictures.region import Region
from brushexp.plugins.blend.base import Blend, Canvas
from brushexp.plugins.loss.base import Painting, Surroundings
from brushexp.plugins.renderer.base import Renderer
from brushexp.plugins.sampler.base import View
from brushexp.strokes.bezier import curve_of, half_width_of
from brushexp.strokes.catalogue import Strokes

COMPARED_ROWS = 256  # pixels: so much of the whole picture is compared at once


class CanvasMemory:
    """Paints what a step looks at, and keeps the whole picture up to date with it.

    Where strokes that a view neither moves nor draws around it touch the region, their pixels are taken from the
    whole picture as it was last seen; elsewhere the region is what it would be in the whole. Differs from the thesis,
    which leaves those strokes out: its ring hides the gap from the active ones.

    Args:
        picture: (3, H, W) the whole painting as it is; it is changed in place.
        target: (3, H, W).
        background: (3,) colour of the bare canvas.
        renderer: draws the strokes.
        blend: lays them over each other.
        n: number of strokes of the painting.
        focus: (H, W) how much each pixel counts; None for all alike.
    """

    def __init__(
        self,
        picture: Tensor,
        target: Tensor,
        background: Tensor,
        renderer: Renderer,
        blend: Blend,
        n: int,
        *,
        focus: Tensor | None = None,
    ) -> None:
        self.picture = picture
        self.target = target
        self.focus = focus
        self.background = background
        self.renderer = renderer
        self.blend = blend
        self.cache = PatchCache(renderer, n)
        self.n = n
        self._squares: float | None = None  # sum of squared errors; None if it has to be computed
        self._view: View | None = None
        self._part = target  # of the target, where the steps look now
        self._focus = focus  # of that part
        self._surroundings: Surroundings | None = None
        self._fixed = torch.empty(0, dtype=torch.bool)  # pixels there that are taken as last seen

    @property
    def error(self) -> float:
        """Mean squared error of the whole picture as it was last seen."""
        if self._squares is None:
            self._squares = _squares_by_rows(self.picture, self.target)
        return max(self._squares, 0.0) / self.target.numel()

    def saw(self, image: Tensor) -> None:
        """Take over a step that moved all strokes and looked at the whole canvas (3, H, W) without this view."""
        self.picture.copy_(image)
        self._squares = None
        self.cache.forget(torch.arange(self.n, device=image.device))

    def paint(
        self, moving: Strokes, strokes: Strokes, view: View, front_to_back: Tensor, *, judge: bool
    ) -> tuple[Canvas, Painting]:
        """The region of a view, differentiable in its active strokes.

        Args:
            moving: the A active strokes, with gradient.
            strokes: all N, without.
            view: where to look.
            front_to_back: (N,) indices of all strokes, the uppermost first.
            judge: measure the accuracy (A,) of the active strokes, too.
        """
        region, active = view.region, view.active
        assert active is not None
        if self._view is None or not _same(self._view, view):
            self._turn_to(view, strokes)
        shift = (-region.left, -region.top)
        layers, known = self.renderer(moving.moved(shift=shift), active), active
        if view.ring is not None and len(view.ring):
            layers = layers.joined(self.cache.layers(strokes[view.ring].moved(shift=shift), view.ring))
            known = torch.cat([active, view.ring])
        place = torch.empty_like(front_to_back)
        place[front_to_back] = torch.arange(len(place), device=place.device)
        size = (region.height, region.width)
        canvas = self.blend(layers, place[known].argsort(), size, self.background, self._part if judge else None)
        image = torch.where(self._fixed, region.of(self.picture).clone(), canvas.image)
        self._paste(image.detach(), region)
        every = {name: value.index_copy(0, active, getattr(moving, name)) for name, value in strokes.items()}
        accuracy = None if canvas.accuracy is None else canvas.accuracy[: len(active)]
        painting = Painting(image, self._part, Strokes(**every), self._surroundings, self._focus)
        return Canvas(image, accuracy), painting

    def _turn_to(self, view: View, strokes: Strokes) -> None:
        """Look elsewhere, or at other strokes; what belongs to the place stays the same object as long as it does."""
        region = view.region
        if self._view is None or self._view.region != region:
            whole = region == Region(0, 0, *self.target.shape[1:])
            around = None if whole else Surroundings(region, self.picture, self.target, self.focus)
            self._part, self._focus = (around.part, around.part_focus) if around else (self.target, self.focus)
            self._surroundings = around
        unknown = torch.ones(len(strokes), dtype=torch.bool, device=self.target.device)
        for number in (view.active, view.ring):
            if number is not None:
                unknown[number] = False
        self._fixed = touched(strokes[unknown], region)
        self._view = view

    @torch.no_grad()
    def _paste(self, image: Tensor, region: Region) -> None:
        """Take over what a step made of a region (3, h, w)."""
        target, seen = region.of(self.target), region.of(self.picture)
        if seen.numel() == self.picture.numel():
            self._squares = None
        elif self._squares is not None:
            self._squares += squares(image, target) - squares(seen, target)
        seen.copy_(image)


def squares(first: Tensor, second: Tensor) -> float:
    """Sum of the squared differences of two pictures."""
    return float((first - second).square().sum(dtype=torch.float64))


def _squares_by_rows(first: Tensor, second: Tensor) -> float:
    """The same of large pictures, without another one of their size."""
    return sum(
        squares(a, b) for a, b in zip(first.split(COMPARED_ROWS, 1), second.split(COMPARED_ROWS, 1), strict=True)
    )


def _same(first: View, second: View) -> bool:
    """Whether both look at the same place and draw the same strokes."""
    if first.region != second.region:
        return False
    for a, b in ((first.active, second.active), (first.ring, second.ring)):
        if (a is None) != (b is None) or (a is not None and b is not None and not torch.equal(a, b)):
            return False
    return True


@torch.no_grad()
def touched(strokes: Strokes, region: Region) -> Tensor:
    """Pixels (h, w), bool, of a region that lie in the box around any of the strokes (N)."""
    curve, reach = curve_of(strokes), SPREAD * half_width_of(strokes)[:, None] + EDGE
    size = torch.tensor([region.width, region.height])
    shift = torch.tensor([region.left, region.top])
    low = ((curve.amin(1) - reach).cpu() - shift).floor().long().clamp_min(0)
    high = torch.minimum(((curve.amax(1) + reach).cpu() - shift).ceil().long(), size)
    inside = (low < high).all(1)
    low, high = low[inside], high[inside]
    # Each box adds 1 at two of its corners and -1 at the others; sums over rows and columns count the boxes of a pixel.
    steps = torch.zeros(region.height + 1, region.width + 1, dtype=torch.int32)
    for x, y, sign in ((low, low, 1), (high, low, -1), (low, high, -1), (high, high, 1)):
        steps.index_put_((y[:, 1], x[:, 0]), torch.tensor(sign, dtype=torch.int32), accumulate=True)
    counts = steps.cumsum(0).cumsum(1)
    return counts[:-1, :-1].gt(0).to(strokes.position.device)
