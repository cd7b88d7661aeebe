"""The whole matrix of extremes: every scene with every renderer, blend and precision."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product

from brushexp.errors import UserError
from brushexp.plugins.blend.base import Blend
from brushexp.plugins.renderer.base import Renderer
from brushexp.registry import build_named, plugins
from brushexp_extremes.check import DTYPES, EXERCISES, Check, Reference, check_drawing, check_painting
from brushexp_extremes.scenes import SCENES

ONE_PICTURE, MANY_STEPS = "one picture", "many steps"
KINDS = {
    ONE_PICTURE: "A picture and the gradient of its mean squared error, against float64.",
    MANY_STEPS: "Strokes after steps of Adam: whether they are finite and in range, and their picture against float64.",
}
FEW_STROKES, MANY_STROKES = 6, 1_000_000  # at most, of a renderer that is slow (with a warm-up renderer), of others


@dataclass(frozen=True)
class MatrixCell:
    """A renderer, a blend and a precision on a scene, and what became of it; ``kind`` is one of `KINDS`."""

    kind: str
    scene: str
    renderer: str
    blend: str
    dtype: str
    check: Check


def chosen_axes(**wanted: Sequence[str] | None) -> dict[str, list[str]]:
    """What is examined: names of renderers, blends, dtypes and scenes.

    ``wanted`` are the names on an axis (a UserError if there is nothing of a name); None or no word of it means all
    that there are, plugins of the user among them.
    """
    axes = {
        "renderers": [plugin.name for plugin in plugins("renderer")],
        "blends": [plugin.name for plugin in plugins("blend")],
        "dtypes": list(DTYPES),
        "scenes": list(dict.fromkeys([*SCENES, *EXERCISES])),
    }
    for key, names in wanted.items():
        for name in names or ():
            if name not in axes[key]:
                known = ", ".join(axes[key])
                raise UserError(f"{key} has no {name!r}; leave {key} at null for all, or choose from: {known}")
    return axes | {key: list(dict.fromkeys(names)) for key, names in wanted.items() if names is not None}


def cells_in(axes: Mapping[str, Sequence[str]]) -> int:
    """How many cells the matrix has."""
    return len(_rows(axes)) * len(axes["renderers"]) * len(axes["blends"]) * len(axes["dtypes"])


def examine(axes: Mapping[str, Sequence[str]], patience: float) -> Iterator[MatrixCell]:
    """Go through the matrix; ``patience`` is what `check_painting` takes."""
    blends = {name: build_named("blend", name, {}) for name in axes["blends"]}
    for name in axes["renderers"]:
        renderer = frozen_renderer(name)
        most = MANY_STROKES if renderer.warm_up is None else FEW_STROKES
        for kind, scene in _rows(axes):
            check: Callable[[Blend, str], Check]
            if kind == ONE_PICTURE:
                check = partial(check_drawing, renderer, Reference(renderer, SCENES[scene].scene(most)))
            else:
                check = partial(check_painting, name, renderer, EXERCISES[scene], patience)
            for blend, dtype in product(blends, axes["dtypes"]):
                yield MatrixCell(kind, scene, name, blend, dtype, check(blends[blend], dtype))


def frozen_renderer(name: str) -> Renderer:
    """A renderer as painting uses it, with its default options."""
    renderer: Renderer = build_named("renderer", name, {})
    return renderer.eval().requires_grad_(False)


def _rows(axes: Mapping[str, Sequence[str]]) -> list[tuple[str, str]]:
    """Kind and scene of each row."""
    there: dict[str, Mapping[str, object]] = {ONE_PICTURE: SCENES, MANY_STEPS: EXERCISES}
    return [(kind, scene) for kind in KINDS for scene in axes["scenes"] if scene in there[kind]]
