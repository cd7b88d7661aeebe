"""Paint by gradient descent."""

from brushexp.registry import register


@register("painter", "gradient")
class GradientDescent:
    """Moves all strokes at once by gradient descent, starting from ``init``.

    Source: Heimbrecht, 2020 (master thesis, Heidelberg), chapter 6. Only this painter reads the keys ``init``,
    ``loss``, ``order``, ``density``, ``sampler``, ``optimizer`` and ``steps``. It is not a `Painter`.
    """

    @classmethod
    def facts(cls) -> dict[str, str]:
        return {"decides by": "gradients"}
