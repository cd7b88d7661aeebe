"""The whole matrix of extremes: every scene with every renderer, blend and precision."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from brushexp.errors import UserError
from brushexp.plugins.renderer.base import Renderer
from brushexp.registry import build_named, plugins
from brushexp.stress.drawing import Reference, draw_cell, most_for
from brushexp.stress.painting import exercises, paint_cell
from brushexp.stress.scenes import SCENES
from brushexp.stress.verdict import DTYPES, Judgement

DRAWN, PAINTED = "one picture", "many steps"
KINDS = {
    DRAWN: "A picture and the gradient of its mean squared error, against float64.",
    PAINTED: "Strokes after steps of Adam: whether they are finite and in range, and their picture against float64.",
}


@dataclass(frozen=True)
class Choice:
    """What is examined.

    Attributes:
        renderers: names.
        blends: names.
        dtypes: names of `verdict.DTYPES`.
        scenes: names of scenes and exercises.
    """

    renderers: Sequence[str]
    blends: Sequence[str]
    dtypes: Sequence[str]
    scenes: Sequence[str]


@dataclass(frozen=True)
class Cell:
    """One of the matrix.

    Attributes:
        kind: of `KINDS`.
        scene: name.
        renderer: name.
        blend: name.
        dtype: name.
        judgement: what became of it.
    """

    kind: str
    scene: str
    renderer: str
    blend: str
    dtype: str
    judgement: Judgement

    @property
    def name(self) -> str:
        """Where it stands."""
        return f"{self.scene} ({self.kind}, renderer={self.renderer}, blend={self.blend}, {self.dtype})"


def choice_of(
    renderers: Sequence[str] | None,
    blends: Sequence[str] | None,
    dtypes: Sequence[str] | None,
    scenes: Sequence[str] | None,
) -> Choice:
    """What these names choose; None means all that there are, plugins of the user among them.

    Raises:
        UserError: if there is nothing of a name.
    """
    return Choice(
        _known("renderers", renderers, [plugin.name for plugin in plugins("renderer")]),
        _known("blends", blends, [plugin.name for plugin in plugins("blend")]),
        _known("dtypes", dtypes, list(DTYPES)),
        _known("scenes", scenes, list(dict.fromkeys([*SCENES, *exercises()]))),
    )


def count(choice: Choice) -> int:
    """Cells of the matrix."""
    scenes = sum((name in SCENES) + (name in exercises()) for name in choice.scenes)
    return scenes * len(choice.renderers) * len(choice.blends) * len(choice.dtypes)


def examine(choice: Choice, patience: float) -> Iterator[Cell]:
    """Go through the matrix; ``patience`` is what `paint_cell` takes."""
    blends = {name: build_named("blend", name, {}) for name in choice.blends}
    for name in choice.renderers:
        renderer = frozen(name)
        for scene in choice.scenes:
            if scene in SCENES:
                reference = Reference(renderer, SCENES[scene](most_for(renderer)))
                for blend, dtype in ((b, d) for b in blends for d in choice.dtypes):
                    found = draw_cell(renderer, blends[blend], reference, dtype)
                    yield Cell(DRAWN, scene, name, blend, dtype, found)
        for scene, exercise in exercises().items():
            if scene in choice.scenes:
                for blend, dtype in ((b, d) for b in blends for d in choice.dtypes):
                    found = paint_cell(name, renderer, blends[blend], dtype, exercise, patience)
                    yield Cell(PAINTED, scene, name, blend, dtype, found)


def frozen(name: str) -> Renderer:
    """A renderer as painting uses it, with its default options."""
    renderer: Renderer = build_named("renderer", name, {})
    return renderer.eval().requires_grad_(False)


def _known(key: str, wanted: Sequence[str] | None, there: list[str]) -> list[str]:
    for name in wanted or []:
        if name not in there:
            raise UserError(f"{key} has no {name!r}; leave {key} at null for all, or choose from: {', '.join(there)}")
    return there if wanted is None else list(dict.fromkeys(wanted))
