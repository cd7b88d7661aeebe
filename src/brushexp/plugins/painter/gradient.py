"""Paint by gradient descent."""

from brushexp.registry import register


@register("painter", "gradient")
class GradientDescent:
    """Moves all strokes at once by gradient descent, starting from ``init``.

    Source: Heimbrecht, 2020 (master's thesis, Heidelberg), chapter 6. The keys ``init``, ``loss``, ``order``,
    ``density``, ``sampler``, ``optimizer`` and ``steps`` apply only to this painter, which is not a subclass of
    `Painter`.
    """

    @classmethod
    def facts(cls) -> dict[str, str]:
        return {"decides by": "gradients"}
