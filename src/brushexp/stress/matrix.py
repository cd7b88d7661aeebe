"""The whole matrix of extremes: every scene with every renderer, blend and precision."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

from brushexp.errors import UserError
from brushexp.plugins.renderer.base import Renderer
from brushexp.registry import build_named, plugins
from brushexp.stress.check import DTYPES, Check
from brushexp.stress.painting import check_painting, exercises
from brushexp.stress.reference import Reference, check_drawing, most_strokes
from brushexp.stress.scenes import SCENES

ONE_PICTURE, MANY_STEPS = "one picture", "many steps"
KINDS = {
    ONE_PICTURE: "A picture and the gradient of its mean squared error, against float64.",
    MANY_STEPS: "Strokes after steps of Adam: whether they are finite and in range, and their picture against float64.",
}


@dataclass(frozen=True)
class MatrixAxes:
    """What is examined, by name; ``dtypes`` are those of `check.DTYPES`, ``scenes`` scenes and exercises."""

    renderers: Sequence[str]
    blends: Sequence[str]
    dtypes: Sequence[str]
    scenes: Sequence[str]


@dataclass(frozen=True)
class MatrixCell:
    """A renderer, a blend and a precision on a scene, and what became of it; ``kind`` is one of `KINDS`."""

    kind: str
    scene: str
    renderer: str
    blend: str
    dtype: str
    check: Check

    @property
    def name(self) -> str:
        """Where it stands."""
        return f"{self.scene} ({self.kind}, renderer={self.renderer}, blend={self.blend}, {self.dtype})"


def axes_of(
    renderers: Sequence[str] | None,
    blends: Sequence[str] | None,
    dtypes: Sequence[str] | None,
    scenes: Sequence[str] | None,
) -> MatrixAxes:
    """What these names choose; None means all that there are, plugins of the user among them.

    Raises:
        UserError: if there is nothing of a name.
    """
    return MatrixAxes(
        _known("renderers", renderers, [plugin.name for plugin in plugins("renderer")]),
        _known("blends", blends, [plugin.name for plugin in plugins("blend")]),
        _known("dtypes", dtypes, list(DTYPES)),
        _known("scenes", scenes, list(dict.fromkeys([*SCENES, *exercises()]))),
    )


def cells_in(axes: MatrixAxes) -> int:
    """How many cells the matrix has."""
    scenes = sum((name in SCENES) + (name in exercises()) for name in axes.scenes)
    return scenes * len(axes.renderers) * len(axes.blends) * len(axes.dtypes)


def examine(axes: MatrixAxes, patience: float) -> Iterator[MatrixCell]:
    """Go through the matrix; ``patience`` is what `check_painting` takes."""
    blends = {name: build_named("blend", name, {}) for name in axes.blends}
    pairs = list(product(axes.blends, axes.dtypes))
    for name in axes.renderers:
        renderer = frozen_renderer(name)
        for scene in (scene for scene in axes.scenes if scene in SCENES):
            reference = Reference(renderer, SCENES[scene].scene(most_strokes(renderer)))
            for blend, dtype in pairs:
                found = check_drawing(renderer, blends[blend], reference, dtype)
                yield MatrixCell(ONE_PICTURE, scene, name, blend, dtype, found)
        for scene, exercise in exercises().items():
            for blend, dtype in pairs if scene in axes.scenes else ():
                found = check_painting(name, renderer, blends[blend], dtype, exercise, patience)
                yield MatrixCell(MANY_STEPS, scene, name, blend, dtype, found)


def frozen_renderer(name: str) -> Renderer:
    """A renderer as painting uses it, with its default options."""
    renderer: Renderer = build_named("renderer", name, {})
    return renderer.eval().requires_grad_(False)


def _known(key: str, wanted: Sequence[str] | None, there: list[str]) -> list[str]:
    for name in wanted or []:
        if name not in there:
            raise UserError(f"{key} has no {name!r}; leave {key} at null for all, or choose from: {', '.join(there)}")
    return there if wanted is None else list(dict.fromkeys(wanted))
