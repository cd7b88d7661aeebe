"""Painting by gradient descent."""

from brushexp.registry import register


@register("painter", "gradient")
class GradientDescent:
    """Move all strokes at once by gradient descent from where ``init`` puts them.

    Source: Heimbrecht, 2020 (master thesis, Heidelberg), chapter 6. Only this painter reads the keys ``init``,
    ``loss``, ``order``, ``density``, ``sampler``, ``optimizer`` and ``steps``. It is no `Painter`.
    """

    @classmethod
    def facts(cls) -> dict[str, str]:
        return {"decides by": "gradients"}
