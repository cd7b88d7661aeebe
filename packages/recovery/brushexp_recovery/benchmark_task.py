"""``task=benchmark``: paintings with known strokes, methods that look for them, scores."""

import logging
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from omegaconf import DictConfig

from brushexp.errors import UserError
from brushexp.system.files import write_picture
from brushexp.system.terminal import as_shown
from brushexp_recovery.baselines import LEARNT, METHODS
from brushexp_recovery.benchmark_report import Row, write_figures, write_report
from brushexp_recovery.benchmark_scenes import KINDS, SEEN, Scene, paint, scenes_of
from brushexp_recovery.given import Given, read_given
from brushexp_recovery.raster.npz import write_npz
from brushexp_recovery.score import score
from brushexp_recovery.truth import Truth, write_truth

log = logging.getLogger(__name__)

Array = NDArray[Any]
SUFFIXES = (".png", ".npy", ".npz", ".h5", ".json")  # of strokes by others
FOLDER = "paintings"


@dataclass(frozen=True)
class Case:
    """One picture in which strokes are to be found."""

    scene: Scene
    look: str  # clean or hard
    image: Array  # (H, W, 3) in [0, 1]
    truth: Truth

    @property
    def name(self) -> str:
        """Name it as its files are called."""
        return self.scene.name + "-hard" * (self.look == "hard")


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Paint, look for strokes, and write ``paintings/``, ``figures.csv``, ``summary.md`` and plots into the folder."""
    (folder / FOLDER).mkdir(exist_ok=True)
    scenes = scenes_of(cfg.kinds or KINDS, cfg.counts, cfg.repeats)
    names = list(METHODS) if cfg.methods is None else list(cfg.methods)
    methods = {name: partial(METHODS[name], **({"weights": cfg.weights} if name in LEARNT else {})) for name in names}
    rows: list[Row] = []
    for number, scene in enumerate(scenes, start=1):
        for case in cases_of(scene, cfg, folder / FOLDER):
            found = {name: timed(method, case) for name, method in methods.items()}
            if cfg.add is not None:
                found["add"] = added(Path(cfg.add), case), float("nan")
            rows += [row_of(case, name, given, seconds, folder) for name, (given, seconds) in found.items()]
            write_figures(folder, rows)  # now: the next painting may take minutes
        log.info("%d of %d paintings: %s", number, len(scenes), scene.name)
    log.info("%s: %s", as_shown(folder), ", ".join(path.name for path in write_report(folder, rows)))
    best = [row for row in rows if row["method"] == "recovery"]
    f1 = {look: [row["f1"] for row in best if row["look"] == look] for look in ("clean", "hard")}
    return {f"f1_{look}": float(np.mean(values)) for look, values in f1.items() if values}


def cases_of(scene: Scene, cfg: DictConfig, folder: Path) -> Iterator[Case]:
    """Paint a scene, write its picture and its truth, and yield what is to be looked at."""
    painted = paint(scene, cfg.side, cfg.seed)
    write_truth(folder / f"{scene.name}.npz", painted.truth)
    for look in ("clean", "hard")[: 1 + cfg.hard]:
        case = Case(scene, look, getattr(painted, look), painted.truth)
        write_picture(folder / f"{case.name}.png", (255 * case.image).round().astype(np.uint8))
        yield case


def timed(method: Any, case: Case) -> tuple[Given, float]:
    """Find strokes by a method that is told their number, and count its seconds."""
    begin = time.perf_counter()
    torch.manual_seed(0)
    given: Given = method(case.image, len(case.truth))
    return given, time.perf_counter() - begin


def added(folder: Path, case: Case) -> Given:
    """Read the strokes that somebody else found in a painting (UserError)."""
    for suffix in SUFFIXES:
        if (path := folder / f"{case.name}{suffix}").is_file():
            return read_given(path, case.image.shape[:2], case.image, "add")
    raise UserError(
        f"add={folder} has no strokes of {case.name}; write {case.name}.npz there, or leave the painting out"
    )


def row_of(case: Case, method: str, given: Given, seconds: float, folder: Path) -> Row:
    """Score what a method found, and keep the regions for a look."""
    figures = score(case.truth, given)
    write_npz(folder / FOLDER / f"{case.name}-{method}.npz", labels=given.labels)
    log.info("%s, %s: F1 %.3f in %.1f s", case.name, method, figures["f1"], seconds)
    place = {"scene": case.scene.name, "kind": case.scene.kind, "seen": case.scene.kind in SEEN}
    return {**place, "count": case.scene.count, "look": case.look, "method": method, **figures, "seconds": seconds}
