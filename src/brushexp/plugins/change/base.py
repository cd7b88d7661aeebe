"""Base class for changes, which modify how a painting is made."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from omegaconf import DictConfig
from torch import Tensor

from brushexp.plugins.blend.base import Compositor
from brushexp.plugins.order.base import Order
from brushexp.plugins.renderer.base import Renderer
from brushexp.strokes.catalogue import Strokes


@dataclass(frozen=True)
class PaintingState:
    """Read-only state of a painting at one moment, passed to changes."""

    target: Tensor  # (3, H, W) in [0, 1], target of the steps
    focus: Tensor | None  # (H, W) weights of the pixels, of mean 1; None for equal weights
    ground: Tensor  # (3,) RGB of the bare canvas
    renderer: Renderer  # current renderer of the strokes
    blend: Compositor
    step: int  # number of steps taken
    steps: int  # planned number of steps; revised in a run with a time limit
    generator: torch.Generator  # source of all randomness in the steps
    strokes: Callable[[], Strokes]  # returns the N strokes without gradient; `Change.limit` must not call it
    order: Callable[[Strokes], Tensor]  # strokes -> their indices (N,), top stroke first
    front_to_back: Tensor  # (N,) the current order, which is not renewed at every step
    draw: Callable[[Strokes, Tensor], Tensor]  # strokes, front to back -> whole picture (3, H, W), without gradient
    zoom: float = 1.0  # pixels of the painting per pixel of the target, which may be smaller
    is_whole: bool = True  # whether the current step covers the whole canvas
    is_coarse: bool = False  # whether the current step works at a smaller size
    is_over: bool = False  # whether no further step follows, even if the run ends early
    is_untouched: bool = False  # whether the strokes come from a catalogue and no step moves them

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the canvas in pixels."""
        return self.target.shape[1], self.target.shape[2]

    @property
    def progress(self) -> float:
        """Completed fraction of all steps, 0 to 1."""
        return self.step / self.steps if self.steps else 1.0


class Change:
    """Modifies how a painting is made; a painting may have several changes. All methods are optional.

    The painter calls, in this order:

    - `settings` and `check` before anything runs: adapt the settings, and check them;
    - `target`, `ground` and `order` once: change the target, the colour of the bare canvas and the stroke order;
    - `begin` once: change the initial strokes;
    - `aim` before each step: change the target and ground of this step;
    - `limit` after each step: clamp the moved strokes to limits;
    - `end` once, after the last step: change the finished strokes (skipped in films, whose strokes keep moving);
    - `enlarge` once, after `end`: correct strokes that were scaled from the target to the painting.

    Changes are applied in order of ascending `rank`, so that the highest rank has the last word; changes of equal rank
    are applied in alphabetical order.

    >>> from dataclasses import replace
    >>> class Red(Change):
    ...     def limit(self, strokes, before, rows, state):
    ...         return replace(strokes, color=strokes.color * torch.tensor([1.0, 0.0, 0.0]))
    >>> Red().limit(Strokes.none(), None, None, None).color.shape
    torch.Size([0, 3])
    """

    rank: ClassVar[int] = 0
    only_ends: ClassVar[bool] = False  # whether the change only implements `end`; films then skip it
    for_all_painters: ClassVar[bool] = False  # whether `end` also applies to painters other than ``gradient``

    def settings(self, cfg: DictConfig) -> DictConfig:
        """Return adapted settings for the painting, or raise a UserError if it cannot be painted."""
        return cfg

    def check(self, cfg: DictConfig, size: tuple[int, int]) -> None:
        """Raise a UserError if the settings are incompatible with this change for a picture of ``size`` (H, W)."""

    def target(self, picture: Tensor) -> Tensor:
        """Return the target (3, H, W) in [0, 1] for a picture whose colours the palette has already mapped."""
        return picture

    def ground(self, color: Tensor) -> Tensor:
        """Return the new colour (3,) of the bare canvas."""
        return color

    def order(self, order: Order) -> Order:
        """Return the new order, which decides which stroke is on top."""
        return order

    def begin(self, strokes: Strokes, state: PaintingState) -> Strokes:
        """Return the N initial strokes, modified by this change."""
        return strokes

    def aim(self, target: Tensor, ground: Tensor, state: PaintingState) -> tuple[Tensor, Tensor]:
        """Return the target (3, H, W) and the ground (3,) of the next step; if unchanged, return the same tensors."""
        return target, ground

    def limit(self, strokes: Strokes, before: Strokes | None, rows: Tensor | None, state: PaintingState) -> Strokes:
        """Clamp A strokes to limits; ``rows`` (A,) holds their indices among all N strokes, or is None for all strokes.

        ``before`` holds the same strokes before the step; it is None if there was no step. Strokes that are already
        within the limits may change only by rounding.
        """
        return strokes

    def end(self, strokes: Strokes, front_to_back: Tensor, state: PaintingState) -> tuple[Strokes, Tensor]:
        """Return the finished strokes, with any added strokes after the N strokes, and their order, top first."""
        return strokes, front_to_back

    def enlarge(self, strokes: Strokes) -> Strokes:
        """Return the N finished strokes, corrected after scaling from the target's pixels to the painting's."""
        return strokes

    def state_dict(self) -> dict[str, Any]:
        """Return the tensors and numbers that a resumed run needs."""
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Load the result of `state_dict`."""


def by_rank(changes: Mapping[str, Change]) -> dict[str, Change]:
    """Sort changes by rank, and by name if their ranks are equal."""
    return dict(sorted(changes.items(), key=lambda pair: (pair[1].rank, pair[0])))
