"""``task=benchmark``: make paintings with known strokes, find the strokes by several methods, and score them."""

import logging
import time
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from omegaconf import DictConfig

from brushexp.contracts import UserError
from brushexp.contracts.files import as_shown, write_picture
from brushexp_recovery.benchmark.baselines.methods import METHODS, TRAINED, Method
from brushexp_recovery.benchmark.prediction import Prediction
from brushexp_recovery.benchmark.prediction_files import read_prediction
from brushexp_recovery.benchmark.report import PAINTINGS, write_figures, write_report
from brushexp_recovery.benchmark.report_tables import Row
from brushexp_recovery.benchmark.scenes import KINDS, SEEN, Scene, list_scenes, paint_scene
from brushexp_recovery.benchmark.score import score
from brushexp_recovery.benchmark.truth import Truth, write_truth
from brushexp_recovery.model.recovery_model import trained_families
from brushexp_recovery.raster.npz import write_npz
from brushexp_recovery.synthesis.families.family import find_families

log = logging.getLogger(__name__)

Array = NDArray[Any]
SUFFIXES = (".png", ".npy", ".npz", ".h5", ".json")  # suffixes of files with strokes by other methods


@dataclass(frozen=True)
class Case:
    """A picture in which each method searches for strokes."""

    scene: Scene
    look: str  # clean or hard
    image: Array  # (H, W, 3) in [0, 1]
    truth: Truth

    @property
    def name(self) -> str:
        """File name of the case, without a suffix."""
        return self.scene.name + "-hard" * (self.look == "hard")


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Paint scenes, find their strokes, and write ``paintings/``, ``figures.csv``, ``summary.md`` and plots."""
    (folder / PAINTINGS).mkdir(exist_ok=True)
    seen = (*SEEN, *trained_families(cfg.weights))
    scenes = list_scenes(choose_kinds(cfg, seen), cfg.counts, cfg.repeats)
    methods = choose_methods(cfg)
    rows: list[Row] = []
    for number, scene in enumerate(scenes, start=1):
        for case in paint_cases(scene, cfg, folder / PAINTINGS):
            for name, method in methods.items():
                prediction, seconds = time_method(method, case)
                rows.append(score_case(case, name, prediction, seconds, folder / PAINTINGS, seen))
            if cfg.add is not None:
                prediction = read_strokes_of_others(Path(cfg.add), case)
                rows.append(score_case(case, "add", prediction, float("nan"), folder / PAINTINGS, seen))
            write_figures(folder, rows)  # already now, because the next painting may take minutes
        log.info("%d of %d paintings: %s", number, len(scenes), scene.name)
    log.info("%s: %s", as_shown(folder), ", ".join(path.name for path in write_report(folder, rows)))
    return mean_scores(rows)


def choose_kinds(cfg: DictConfig, seen: Collection[str]) -> list[str]:
    """Return the requested kinds of paintings, without the ``seen`` kinds if only unseen kinds are requested."""
    kinds = cfg.kinds or ([*KINDS, *sorted(find_families())] if cfg.unseen else KINDS)
    chosen = [kind for kind in kinds if not (cfg.unseen and kind in seen)]
    if not chosen:
        raise UserError(
            f"{cfg.weights} was trained on all kinds in kinds=; train with families=true leave_out=[{kinds[0]}], or "
            "set unseen=false"
        )
    return chosen


def choose_methods(cfg: DictConfig) -> dict[str, Method]:
    """Return the requested methods, or all methods if none are named; trained methods receive their weights."""
    names = list(METHODS) if cfg.methods is None else list(cfg.methods)
    return {name: partial(METHODS[name], weights=cfg.weights) if name in TRAINED else METHODS[name] for name in names}


def paint_cases(scene: Scene, cfg: DictConfig, folder: Path) -> Iterator[Case]:
    """Paint a scene, write its pictures and ground truth, and yield a case for each picture."""
    painting = paint_scene(scene, cfg.side, cfg.seed)
    write_truth(folder / f"{scene.name}.npz", painting.truth)
    images = {"clean": painting.clean, "hard": painting.hard} if cfg.hard else {"clean": painting.clean}
    for look, image in images.items():
        case = Case(scene, look, image, painting.truth)
        write_picture(folder / f"{case.name}.png", (255 * image).round().astype(np.uint8))
        yield case


def time_method(method: Method, case: Case) -> tuple[Prediction, float]:
    """Run a method, given the true number of strokes; return the strokes that it finds and its time in seconds."""
    begin = time.perf_counter()
    torch.manual_seed(0)
    prediction = method(case.image, len(case.truth))
    return prediction, time.perf_counter() - begin


def read_strokes_of_others(folder: Path, case: Case) -> Prediction:
    """Read the strokes that another method found in a painting; raise UserError if their file is missing."""
    for suffix in SUFFIXES:
        if (path := folder / f"{case.name}{suffix}").is_file():
            return read_prediction(path, case.image.shape[:2], case.image, "add")
    raise UserError(
        f"add={folder} has no strokes for {case.name}; write {case.name}.npz there, or leave the painting out"
    )


def score_case(
    case: Case, method: str, prediction: Prediction, seconds: float, folder: Path, seen: Collection[str]
) -> Row:
    """Score a method's strokes, and store their regions; ``seen`` lists the kinds of paintings used in training."""
    figures = score(case.truth, prediction)
    write_npz(folder / f"{case.name}-{method}.npz", labels=prediction.labels)
    log.info("%s, %s: F1 %.3f in %.1f s", case.name, method, figures["f1"], seconds)
    return {
        "scene": case.scene.name,
        "kind": case.scene.kind,
        "seen": case.scene.kind in seen,
        "count": case.scene.count,
        "look": case.look,
        "method": method,
        **figures,
        "seconds": seconds,
    }


def mean_scores(rows: list[Row]) -> dict[str, object]:
    """Average the F1 of recovery separately over the clean pictures and over the degraded ones, if there are any."""
    means: dict[str, object] = {}
    for look in ("clean", "hard"):
        values = [row["f1"] for row in rows if row["method"] == "recovery" and row["look"] == look]
        if values:
            means[f"f1_{look}"] = float(np.mean(values))
    return means
