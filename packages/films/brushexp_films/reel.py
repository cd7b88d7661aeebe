"""A film: the first picture of each scene is painted as one is, and from there its strokes are carried on."""

from collections.abc import Callable

import torch
from torch import Tensor

from brushexp.painting.picture import Picture
from brushexp_films.carrying import Carrier, Cel
from brushexp_films.changes import Changes
from brushexp_films.motion import motion


class Reel:
    """Where a painted film stands; what it is at a picture depends on that picture's strokes and on the film alone.

    So a film goes on from the strokes of its last picture as if it had never stopped: see `follow`.
    """

    cel: Cel  # strokes of the last picture

    def __init__(self, begin: Callable[[Tensor], Cel], carrier: Carrier, threshold: float) -> None:
        self.begin = begin  # paints the first picture (3, H, W) of a scene
        self.carrier = carrier
        self.changes = Changes(threshold)
        self.image = torch.empty(0)  # (3, H, W) the last picture as painted, without light
        self.scenes = 0

    def paint(self, picture: Tensor) -> None:
        """Paint the next picture (3, H, W), in [0, 1]."""
        before = self.changes.held
        changed = self._see(picture)
        if self.changes.begins:
            self.show(self.begin(picture))
        elif changed.any():
            held = self.changes.held
            self.show(self.carrier(self.cel, self.image, held, changed, motion(before, held)))

    def follow(self, picture: Tensor, cel: Cel) -> None:
        """Take over the strokes of the next picture, which has been painted already."""
        self._see(picture)
        self.show(cel)

    def _see(self, picture: Tensor) -> Tensor:
        changed = self.changes(picture)
        self.scenes += self.changes.begins
        return changed

    def show(self, cel: Cel) -> None:
        """Paint the strokes of a picture."""
        canvas = Picture(self.changes.held, None, cel.background, self.carrier.components.blend)
        canvas.renderer = self.carrier.renderer
        self.cel, self.image = cel, canvas.draw(cel.strokes, cel.front_to_back)
