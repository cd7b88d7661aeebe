"""The render image catalogue (thesis 2020, 6.3): pictures of strokes that need not be drawn again."""

import torch
from torch import Tensor

from brushexp.compositing.layers import Layers
from brushexp.compositing.windows import Windows
from brushexp.plugins.renderer.base import PatchRenderer, Renderer
from brushexp.strokes.catalogue import Strokes

MAX_CACHE_BYTES = 2**29  # of pictures that are kept: 16,384 of 64 x 64 pixels


class PatchCache:
    """Keeps what a network has drawn, so that strokes which only surround others need not be drawn at every step.

    Pictures are drawn when they are first asked for, in memory of a fixed size from which the oldest give way, and are
    up to date: a stroke that has changed is forgotten. They are kept as 16-bit floating point numbers (an error of
    1/4096 at most). A renderer of profiles has no pictures; its strokes are just described again. The thesis keeps all
    pictures and replaces them after every step.

    Args:
        renderer: draws the strokes.
        n: number of strokes of the painting.
        most_bytes: of memory for pictures.
    """

    def __init__(self, renderer: Renderer, n: int, most_bytes: int = MAX_CACHE_BYTES) -> None:
        self.renderer = renderer
        if isinstance(renderer, PatchRenderer):
            side = renderer.window
            room = max(1, min(n, most_bytes // (2 * 4 * side * side)))
            self._pictures = torch.empty(room, 4, side, side, dtype=torch.float16)
            self._owner = torch.full((room,), -1)  # stroke of each picture
            self._place = torch.full((n,), -1)  # picture of each stroke
            self._next = 0  # place of the next picture

    def forget(self, number: Tensor) -> None:
        """Strokes (K,) have changed."""
        if isinstance(self.renderer, PatchRenderer):
            place = self._place[number.cpu()]
            self._owner[place[place >= 0]] = -1
            self._place[number.cpu()] = -1

    @torch.no_grad()
    def layers(self, strokes: Strokes, number: Tensor) -> Layers:
        """Layers of K strokes, number (K,) of the painting, without gradient."""
        if not isinstance(self.renderer, PatchRenderer):
            return self.renderer(strokes, number)
        place = self._place[number.cpu()]
        new = place < 0
        pictures = self._pictures[place.clamp_min(0)].to(strokes.color)
        if new.any():
            missing = new.nonzero()[:, 0].to(number.device)
            drawn = self.renderer(strokes[missing], number[missing])
            assert isinstance(drawn, Windows)
            pictures[missing] = drawn.images
            self._keep(number[missing].cpu(), drawn.images)
        return Windows(pictures, strokes.position, strokes.scale, strokes.opacity, strokes.color)

    def _keep(self, number: Tensor, images: Tensor) -> None:
        room = len(self._owner)
        number, images = number[:room], images[:room]
        place = (self._next + torch.arange(len(number))) % room
        self._next = int(self._next + len(number)) % room
        before = self._owner[place]
        self._place[before[before >= 0]] = -1
        self._owner[place], self._place[number] = number, place
        self._pictures[place] = images.to("cpu", torch.float16)
