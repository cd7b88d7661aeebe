"""Paint part of the canvas, and leave the rest unchanged."""

from dataclasses import dataclass

import torch
from torch import Tensor

from brushexp.compositing.layers import Canvas, Layers
from brushexp.compositing.windows import Windows
from brushexp.pictures.region import Region
from brushexp.plugins.blend.base import Compositor
from brushexp.plugins.loss.base import PaintedView, Surroundings
from brushexp.plugins.renderer.base import PatchRenderer, Renderer, reach_of
from brushexp.plugins.sampler.base import View
from brushexp.strokes.bezier import curve_of
from brushexp.strokes.catalogue import Strokes

COMPARED_ROWS = 256  # pixel rows of two pictures compared at a time, to save memory
MAX_CACHE_BYTES = 2**29  # memory for cached pictures: 16,384 of 64 x 64 pixels


@dataclass(eq=False)
class CanvasMemory:
    """Paints the region that a step compares with the target, and keeps the whole picture up to date.

    Where strokes that are neither active nor in the view's ring overlap the region, its pixels are taken from the last
    whole picture. The thesis instead omits these strokes, and relies on the ring to hide the gap.
    """

    picture: Tensor  # (3, H, W) the whole painting, changed in place; the other fields are those of `Picture`
    target: Tensor
    focus: Tensor | None
    background: Tensor
    renderer: Renderer
    blend: Compositor

    def __post_init__(self) -> None:
        self.cache = PatchCache(self.renderer)
        self._squares = float(sum_of_squares(self.picture, self.target))
        self._region: Region | None = None  # region of the current steps
        self._numbers = torch.empty(0)  # indices of the strokes drawn in the region
        self._fixed = torch.empty(0)  # (h, w) bool: pixels of the region that do not change
        self._surroundings: Surroundings | None = None  # surroundings of the region; None if it is the whole canvas

    @property
    def error(self) -> float:
        """Mean squared error of the last whole picture."""
        return max(self._squares, 0.0) / self.target.numel()

    def paint(
        self, moving: Strokes, strokes: Strokes, view: View, front_to_back: Tensor, *, accuracy: bool
    ) -> tuple[Canvas, PaintedView]:
        """Paint the region of a view, differentiably with respect to its active strokes; see `Picture.see`."""
        region, active, ring = view.region, view.active, view.ring
        assert active is not None
        numbers = active if ring is None else torch.cat([active, ring])
        self._turn_to(region, numbers, strokes)
        around = self._surroundings
        part, focus = (around.part, around.part_focus) if around else (self.target, self.focus)
        shift = (-region.left, -region.top)
        layers = self.renderer(moving.moved(shift=shift))
        if ring is not None and len(ring):
            layers = layers.joined(self.cache.layers(strokes[ring].moved(shift=shift), ring))
        place = torch.empty_like(front_to_back)
        place[front_to_back] = torch.arange(len(place), device=place.device)
        size = (region.height, region.width)
        canvas = self.blend(layers, place[numbers].argsort(), size, self.background, part if accuracy else None)
        image = torch.where(self._fixed, region.of(self.picture).clone(), canvas.image)
        self._paste(image.detach(), region)
        measures = None if canvas.accuracy is None else canvas.accuracy[: len(active)]
        return Canvas(image, measures), PaintedView(image, part, strokes.with_rows(active, moving), around, focus)

    def _turn_to(self, region: Region, numbers: Tensor, strokes: Strokes) -> None:
        """Switch to another region or other strokes; objects for the same region are reused."""
        is_new = region != self._region
        if is_new:
            whole = region == Region.whole(self.target)
            self._surroundings = None if whole else Surroundings(region, self.picture, self.target, self.focus)
        if is_new or not torch.equal(numbers, self._numbers):
            others = torch.ones(len(strokes), dtype=torch.bool, device=self.target.device)
            others[numbers] = False
            self._fixed = find_reaching(strokes[others], region, self.renderer.edge)
        self._region, self._numbers = region, numbers

    @torch.no_grad()
    def _paste(self, image: Tensor, region: Region) -> None:
        target, before = region.of(self.target), region.of(self.picture)
        self._squares += float(sum_of_squares(image, target) - sum_of_squares(before, target))
        before.copy_(image)


class PatchCache:
    """Caches the pictures that a network has drawn of the strokes around the active ones.

    It holds up to ``most_bytes`` bytes of pictures as 16-bit floats, with errors of at most 1/4096, and discards the
    oldest pictures first. Renderers that draw profiles do not need a cache. In the thesis (2020, 6.3), the cache is
    called the render image catalogue, holds all pictures, and is updated at every step.
    """

    def __init__(self, renderer: Renderer, most_bytes: int = MAX_CACHE_BYTES) -> None:
        self.renderer, self.most_bytes = renderer, most_bytes
        self._pictures: dict[int, Tensor] = {}  # index of a stroke -> picture (4, side, side), oldest first

    def forget(self, number: Tensor) -> None:
        """Discard the pictures of strokes that have changed; ``number`` (K,) holds their indices."""
        for key in number.tolist() if self._pictures else ():
            self._pictures.pop(key, None)

    @torch.no_grad()
    def layers(self, strokes: Strokes, number: Tensor) -> Layers:
        """Draw K strokes without gradient, reusing cached pictures; ``number`` (K,) holds their indices."""
        if not isinstance(self.renderer, PatchRenderer):
            return self.renderer(strokes)
        keys = number.tolist()
        new = torch.tensor([i for i, key in enumerate(keys) if key not in self._pictures], device=number.device)
        if len(new):
            drawn = self.renderer(strokes[new])
            assert isinstance(drawn, Windows)
            images = drawn.images.to("cpu", torch.float16)
            self._pictures |= {keys[i]: image.clone() for i, image in zip(new.tolist(), images, strict=True)}
        pictures = torch.stack([self._pictures[key] for key in keys]).to(strokes.color)
        room = max(1, self.most_bytes // pictures[0].numel() // 2)
        for key in list(self._pictures)[:-room]:
            del self._pictures[key]
        return Windows(pictures, strokes.position, strokes.scale, strokes.opacity, strokes.color)


def sum_of_squares(first: Tensor, second: Tensor) -> Tensor:
    """Sum the squared differences between two pictures."""
    rows = zip(first.split(COMPARED_ROWS, 1), second.split(COMPARED_ROWS, 1), strict=True)
    return torch.stack([(a - b).square().sum(dtype=torch.float64) for a, b in rows]).sum()


@torch.no_grad()
def boxes_of(strokes: Strokes, edge: float) -> tuple[Tensor, Tensor]:
    """Compute opposite corners (N, 2) of the box of pixels that each stroke may cover; see `Renderer.edge`."""
    curve, reach = curve_of(strokes), reach_of(strokes, edge)[:, None]
    return curve.amin(1) - reach, curve.amax(1) + reach


@torch.no_grad()
def find_reaching(strokes: Strokes, region: Region, edge: float) -> Tensor:
    """Mark the pixels of a region, as (h, w) bool, that lie in the bounding box (`boxes_of`) of at least one stroke."""
    left_top, right_bottom = boxes_of(strokes, edge)
    device = left_top.device
    size = torch.tensor([region.width, region.height], device=device)
    shift = torch.tensor([region.left, region.top], device=device)
    low = (left_top - shift).floor().long().clamp_min(0)
    high = torch.minimum((right_bottom - shift).ceil().long(), size)
    inside = (low < high).all(1)
    low, high = low[inside], high[inside]
    # Each box adds 1 at two corners and -1 at the others; cumulative sums over rows and columns count boxes per pixel.
    steps = torch.zeros(region.height + 1, region.width + 1, dtype=torch.int32, device=device)
    for x, y, sign in ((low, low, 1), (high, low, -1), (low, high, -1), (high, high, 1)):
        steps.index_put_((y[:, 1], x[:, 0]), steps.new_tensor(sign), accumulate=True)
    return steps.cumsum(0).cumsum(1)[:-1, :-1].gt(0)
