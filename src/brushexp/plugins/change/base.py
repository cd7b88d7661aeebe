"""The contract of changes."""

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
    """A painting at one moment, for whoever changes it; nothing in it is to be written to."""

    target: Tensor  # (3, H, W) in [0, 1] what the steps aim at
    focus: Tensor | None  # (H, W) how much each pixel counts, of mean 1; None for all alike
    ground: Tensor  # (3,) RGB of the bare canvas
    renderer: Renderer  # draws the strokes now
    blend: Compositor
    step: int  # steps that are done
    steps: int  # in all; a run with a limit of seconds corrects it
    generator: torch.Generator  # source of everything random in the steps
    strokes: Callable[[], Strokes]  # the N strokes, without gradient; not to be called by `Change.limit`
    order: Callable[[Strokes], Tensor]  # strokes -> their numbers (N,), the uppermost first
    front_to_back: Tensor  # (N,) the present order, which is not renewed at every step
    draw: Callable[[Strokes, Tensor], Tensor]  # strokes, front to back -> whole picture (3, H, W), without gradient
    zoom: float = 1.0  # pixels of the painting for one of the target, which may be a smaller picture
    is_whole: bool = True  # whether the present step looks at all of the canvas
    is_coarse: bool = False  # whether it does so at half the size
    is_over: bool = False  # whether no step follows, also where the run ends before its plan
    is_untouched: bool = False  # whether the strokes are those of a catalogue that no step moves

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the canvas in pixels."""
        return self.target.shape[1], self.target.shape[2]

    @property
    def progress(self) -> float:
        """Share of all steps that are done, 0 to 1."""
        return self.step / self.steps if self.steps else 1.0


class Change:
    """Says what is different about one painting: several changes of it may be chosen. Each method may be left out.

    The painter asks, in this order:

    - `settings` and `check` before anything runs: under which settings it is painted, and whether they fit;
    - `target`, `ground` and `order` once: what is painted, on what, and which stroke lies on top;
    - `begin` once: the first strokes;
    - before each step `aim`: what this step aims at, and on which ground;
    - after each step `limit`: what the strokes that have moved may be;
    - `end` once, after the last step: what is done to finished strokes. A film, whose strokes move on, leaves it out.

    Of several changes those of a lower `rank` come first, and the last word is with the highest; of equal ranks the
    order of names decides.

    >>> from dataclasses import replace
    >>> class Red(Change):
    ...     def limit(self, strokes, before, rows, state):
    ...         return replace(strokes, color=strokes.color * torch.tensor([1.0, 0.0, 0.0]))
    >>> Red().limit(Strokes.none(), None, None, None).color.shape
    torch.Size([0, 3])
    """

    rank: ClassVar[int] = 0
    only_ends: ClassVar[bool] = False  # whether it does nothing but `end` a painting; a film then does without it
    for_all_painters: ClassVar[bool] = False  # whether `end` also holds for paintings of other painters than gradient

    def settings(self, cfg: DictConfig) -> DictConfig:
        """Return the settings under which a picture is painted; a UserError if there are none."""
        return cfg

    def check(self, cfg: DictConfig, size: tuple[int, int]) -> None:
        """Refuse (UserError) what does not fit these settings of a picture of ``size`` (H, W)."""

    def target(self, picture: Tensor) -> Tensor:
        """Return what is painted (3, H, W), in [0, 1], of a picture in the colours of its palette."""
        return picture

    def ground(self, color: Tensor) -> Tensor:
        """Return the colour (3,) of the bare canvas."""
        return color

    def order(self, order: Order) -> Order:
        """Return what decides which stroke lies on top."""
        return order

    def begin(self, strokes: Strokes, state: PaintingState) -> Strokes:
        """Return the first N strokes."""
        return strokes

    def aim(self, target: Tensor, ground: Tensor, state: PaintingState) -> tuple[Tensor, Tensor]:
        """Return the target (3, H, W) and the ground (3,) of the next step; the same tensors where nothing changes."""
        return target, ground

    def limit(self, strokes: Strokes, before: Strokes | None, rows: Tensor | None, state: PaintingState) -> Strokes:
        """Return what A strokes may be, number ``rows`` (A,) of all N; None for all of them.

        They have taken a step, and were ``before`` it; None without a step. Strokes that keep to the limit already stay
        as they are, but for rounding.
        """
        return strokes

    def end(self, strokes: Strokes, front_to_back: Tensor, state: PaintingState) -> tuple[Strokes, Tensor]:
        """Return finished strokes and their order: the N strokes first, then those that this adds to them."""
        return strokes, front_to_back

    def state_dict(self) -> dict[str, Any]:
        """Return the tensors and numbers that a resumed run needs."""
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take over what `state_dict` gave."""


def by_rank(changes: Mapping[str, Change]) -> dict[str, Change]:
    """Sort changes by rank, and those of one rank by name."""
    return dict(sorted(changes.items(), key=lambda pair: (pair[1].rank, pair[0])))
