"""The whole matrix of extremes: every scene with every renderer, blend and precision, and a picture of all cells."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from brushexp.errors import UserError
from brushexp.plugins.renderer.base import Renderer
from brushexp.registry import build_named, plugins
from brushexp.reporting.plotting import INK, new_figure, save_figure, without_math
from brushexp_extremes.check import DEGRADED, DTYPES, PICTURE_BOUNDS, VERDICTS, SceneCheck, check_painting
from brushexp_extremes.scenes import KINDS, MANY_STEPS, ONE_PICTURE

FEW_STROKES, MANY_STROKES = 6, 1_000_000  # at most, of a renderer that is slow (with a warm-up renderer), of others
# Of exact, degraded, refused and broken cells: told apart by the colour-blind too, by lightness as well as by hue.
COLORS = ("#B7DFCB", "#F2C14E", "#C9CBD1", "#C0392B")
ROW_INCHES, MARGIN_INCHES = 0.2, 2.5  # height of a row, and of what stands around the rows

Cell = dict[str, Any]  # kind, scene, renderer, blend, dtype, verdict, picture, gradient, note


def chosen_axes(**chosen: Sequence[str] | None) -> dict[str, list[str]]:
    """What is examined: names of renderers, blends, dtypes and scenes.

    None stands for all that there are, plugins of the user among them; a UserError if there is nothing of a name.
    """
    axes = {
        "renderers": [plugin.name for plugin in plugins("renderer")],
        "blends": [plugin.name for plugin in plugins("blend")],
        "dtypes": list(DTYPES),
        "scenes": list(ONE_PICTURE | MANY_STEPS),
    }
    for key, name in ((key, name) for key, names in chosen.items() for name in names or ()):
        if name not in axes[key]:
            names = ", ".join(axes[key])
            raise UserError(f"{key} has no {name!r}; leave {key} at null for all, or choose from: {names}")
    return axes | {key: list(dict.fromkeys(names)) for key, names in chosen.items() if names is not None}


def rows_in(axes: Mapping[str, Sequence[str]]) -> list[tuple[str, str]]:
    """Kind and scene of each row."""
    return [(kind, scene) for kind, scenes in KINDS.items() for scene in axes["scenes"] if scene in scenes]


def cells_in(axes: Mapping[str, Sequence[str]]) -> int:
    """How many cells the matrix has."""
    return len(rows_in(axes)) * len(axes["renderers"]) * len(axes["blends"]) * len(axes["dtypes"])


def examine(axes: Mapping[str, Sequence[str]], patience: float) -> Iterator[Cell]:
    """Go through the matrix; ``patience`` is what `check_painting` takes."""
    blends = {name: build_named("blend", name, {}) for name in axes["blends"]}
    for name in axes["renderers"]:
        renderer = frozen_renderer(name)
        most = MANY_STROKES if renderer.warm_up is None else FEW_STROKES
        for kind, title in rows_in(axes):
            scene = KINDS[kind][title]
            if scene.steps:
                check: Callable[[Any, str], Any] = partial(check_painting, name, renderer, scene, patience)
            else:
                check = SceneCheck(renderer, scene, most).check
            for blend, dtype in product(blends, axes["dtypes"]):
                place = {"kind": kind, "scene": title, "renderer": name, "blend": blend, "dtype": dtype}
                yield place | vars(check(blends[blend], dtype))


def frozen_renderer(name: str) -> Renderer:
    """A renderer as painting uses it, with its default options."""
    renderer: Renderer = build_named("renderer", name, {})
    return renderer.eval().requires_grad_(False)


def counts_of(cells: Sequence[Cell]) -> dict[str, int]:
    """How many cells have each verdict."""
    verdicts = [cell["verdict"] for cell in cells]
    return {verdict: verdicts.count(verdict) for verdict in VERDICTS}


def draw_matrix(cells: Sequence[Cell], path: Path) -> None:
    """Write a PNG: a field for each cell, coloured by its verdict, with its number."""
    from matplotlib.colors import ListedColormap  # noqa: PLC0415

    rows = list(dict.fromkeys((cell["kind"], cell["scene"]) for cell in cells))
    columns = list(dict.fromkeys((cell["renderer"], cell["blend"], cell["dtype"]) for cell in cells))
    figure, levels = new_figure(ROW_INCHES * len(rows) + MARGIN_INCHES), np.full((len(rows), len(columns)), np.nan)
    axes = figure.subplots()
    for cell in cells:
        y = rows.index((cell["kind"], cell["scene"]))
        x = columns.index((cell["renderer"], cell["blend"], cell["dtype"]))
        levels[y, x] = VERDICTS.index(cell["verdict"])
        axes.text(x, y, number_of(cell), ha="center", va="center", fontsize=5, color=INK)
    axes.imshow(levels, cmap=ListedColormap(COLORS), vmin=-0.5, vmax=len(COLORS) - 0.5, aspect="auto")
    axes.set_yticks(range(len(rows)), [without_math(f"{scene}, {kind}") for kind, scene in rows], fontsize=7)
    axes.set_xticks(range(len(columns)), [without_math(" ".join(words)) for words in columns], fontsize=7, rotation=90)
    title = ", ".join(f"{count} {verdict}" for verdict, count in counts_of(cells).items())
    axes.set_title(title, fontsize=11, loc="left", color=INK)
    save_figure(figure, path)


def number_of(cell: Cell) -> str:
    """By how much a cell differs: of a pixel, or, marked with g, of a gradient where only that is out of bounds."""
    if cell["picture"] is None:
        return ""
    of_gradient = cell["verdict"] == DEGRADED and cell["picture"] <= PICTURE_BOUNDS[cell["dtype"]]
    value = cell["gradient" if of_gradient else "picture"]
    return "g " * of_gradient + (f"{value:.0e}".replace("e-0", "e-").replace("e+0", "e") if value else "0")
