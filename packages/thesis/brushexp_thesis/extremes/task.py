"""``task=extremes``: draw and optimise extreme scenes with every renderer, blend and precision; check the results."""

import logging
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import lightning as L
import numpy as np
from brushexp_studies.plotting import INK, new_figure, save_figure, without_math
from matplotlib.colors import ListedColormap
from omegaconf import DictConfig

from brushexp.contracts import UserError, build_named, plugins
from brushexp.contracts.families import Renderer
from brushexp.contracts.files import with_progress, write_json, write_text
from brushexp.contracts.machine import peak_memory
from brushexp.contracts.results import csv_table
from brushexp.contracts.runs import Status
from brushexp_thesis.extremes.check import (
    BROKEN,
    DEGRADED,
    DTYPES,
    PICTURE_BOUNDS,
    VERDICTS,
    SceneCheck,
    check_painting,
)
from brushexp_thesis.extremes.scenes import KINDS, MANY_STEPS, ONE_PICTURE

log = logging.getLogger(__name__)
# Colours of exact, degraded, refused and broken cells, which colour-blind people can distinguish.
COLORS = ("#B7DFCB", "#F2C14E", "#C9CBD1", "#C0392B")
Cell = dict[str, Any]  # kind, scene, renderer, blend, dtype, verdict, picture, gradient, note


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Check all cells of the matrix; write extremes.csv and extremes.png; raise UserError if any cell is broken."""
    L.seed_everything(cfg.seed, verbose=False)
    axes = choose_axes(renderers=cfg.renderers, blends=cfg.blends, dtypes=cfg.dtypes, scenes=cfg.scenes)
    cells = list(with_progress(examine(axes, cfg.patience), cells_in(axes), "examining cells"))
    write_text(folder / "extremes.csv", csv_table(cells, significant=3))
    counts = {verdict: sum(cell["verdict"] == verdict for cell in cells) for verdict in VERDICTS}
    told = ", ".join(f"{count} {verdict}" for verdict, count in counts.items())
    draw_matrix(cells, told, folder / "extremes.png")
    metrics: dict[str, object] = {f"n_{verdict}": count for verdict, count in counts.items()}
    metrics |= {"seconds_total": time.monotonic() - start, "peak_memory_mb": peak_memory()}
    metrics |= {"picture": "extremes.png", "status": Status.COMPLETED}
    write_json(folder / "metrics.json", metrics)
    log.info("%s; %s", told, folder)
    broken = [cell for cell in cells if cell["verdict"] == BROKEN]
    if broken:
        first = "{scene} ({kind}, renderer={renderer}, blend={blend}, {dtype}): {note}".format(**broken[0])
        raise UserError(
            f"{len(broken)} of {len(cells)} cells are broken, the first is {first}; see {folder / 'extremes.csv'}"
        )
    return metrics


def choose_axes(**chosen: Sequence[str] | None) -> dict[str, list[str]]:
    """Return the renderers, blends, dtypes and scenes to examine; None selects all, including the user's plugins."""
    axes = {
        "renderers": [plugin.name for plugin in plugins("renderer")],
        "blends": [plugin.name for plugin in plugins("blend")],
        "dtypes": list(DTYPES),
        "scenes": list(ONE_PICTURE | MANY_STEPS),
    }
    for key, names in chosen.items():
        if unknown := [name for name in names or () if name not in axes[key]]:
            choices = ", ".join(axes[key])
            raise UserError(f"{key} has no {unknown[0]!r}; leave {key} at null for all, or choose from: {choices}")
    return axes | {key: list(dict.fromkeys(names)) for key, names in chosen.items() if names is not None}


def rows_in(axes: Mapping[str, Sequence[str]]) -> list[tuple[str, str]]:
    """List the kind and the scene of each row of the matrix."""
    return [(kind, scene) for kind, scenes in KINDS.items() for scene in axes["scenes"] if scene in scenes]


def cells_in(axes: Mapping[str, Sequence[str]]) -> int:
    """Count the cells of the matrix."""
    return len(rows_in(axes)) * len(axes["renderers"]) * len(axes["blends"]) * len(axes["dtypes"])


def examine(axes: Mapping[str, Sequence[str]], patience: float) -> Iterator[Cell]:
    """Check every cell of the matrix, and yield its results; see `check_painting` for ``patience``."""
    blends = {name: build_named("blend", name, {}) for name in axes["blends"]}
    for name in axes["renderers"]:
        renderer = frozen_renderer(name)
        most = 1_000_000 if renderer.warm_up is None else 6  # number of strokes; renderers with a warm-up are slow
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
    """Build a renderer with its default options, in evaluation mode and without trainable weights."""
    return build_named("renderer", name, {}).eval().requires_grad_(False)


def draw_matrix(cells: Sequence[Cell], title: str, path: Path) -> None:
    """Write a PNG with one box for each cell, coloured by its verdict and labelled with its error."""
    rows = list(dict.fromkeys((cell["kind"], cell["scene"]) for cell in cells))
    columns = list(dict.fromkeys((cell["renderer"], cell["blend"], cell["dtype"]) for cell in cells))
    figure, levels = new_figure(0.2 * len(rows) + 2.5), np.full((len(rows), len(columns)), np.nan)
    axes = figure.subplots()
    for cell in cells:
        y = rows.index((cell["kind"], cell["scene"]))
        x = columns.index((cell["renderer"], cell["blend"], cell["dtype"]))
        levels[y, x] = VERDICTS.index(cell["verdict"])
        axes.text(x, y, number_of(cell), ha="center", va="center", fontsize=5, color=INK)
    axes.imshow(levels, cmap=ListedColormap(COLORS), vmin=-0.5, vmax=len(COLORS) - 0.5, aspect="auto")
    axes.set_yticks(range(len(rows)), [without_math(f"{scene}, {kind}") for kind, scene in rows], fontsize=7)
    axes.set_xticks(range(len(columns)), [without_math(" ".join(words)) for words in columns], fontsize=7, rotation=90)
    axes.set_title(title, fontsize=11, loc="left", color=INK)
    save_figure(figure, path)


def number_of(cell: Cell) -> str:
    """Format a cell's pixel error or, if only the gradient error is out of bounds, the gradient error after a "g"."""
    if cell["picture"] is None:
        return ""
    of_gradient = cell["verdict"] == DEGRADED and cell["picture"] <= PICTURE_BOUNDS[cell["dtype"]]
    value = cell["gradient" if of_gradient else "picture"]
    return "g " * of_gradient + (f"{value:.0e}".replace("e-0", "e-").replace("e+0", "e") if value else "0")
