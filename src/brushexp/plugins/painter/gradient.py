"""Gradient descent, the program's own way."""

from brushexp.registry import register


@register("painter", "gradient")
class GradientDescent:
    """All strokes at once, moved by gradient descent from where ``init`` puts them: what the other families are for.

    Source: Heimbrecht, 2020 (master thesis, Heidelberg), chapter 6. The keys ``init``, ``loss``, ``order``,
    ``density``, ``sampler``, ``optimizer``, ``steps`` and those around them speak of it alone. It is the absence of a
    `Painter`.
    """

    @classmethod
    def facts(cls) -> dict[str, str]:
        return {"decides by": "gradients"}
