"""Gradient descent, the program's own way."""

from collections.abc import Iterator

from brushexp.plugins.painter.base import Commission, PaintingMethod, PaintingState
from brushexp.registry import register


@register("painter", "gradient")
class GradientDescent(PaintingMethod):
    """All strokes at once, moved by gradient descent from where ``init`` puts them: what the other families are for.

    Source: Heimbrecht, 2020 (master thesis, Heidelberg), chapter 6. It is the only painter that ``init``, ``loss``,
    ``order``, ``density``, ``sampler``, ``optimizer``, ``steps`` and the keys around them speak of.
    """

    kind = "gradients"
    by_steps = True

    def __call__(self, commission: Commission) -> Iterator[PaintingState]:
        return iter(())
