"""Helpers that write made-up runs to disk, in the layout of a sweep."""

import csv
import json
from itertools import product
from pathlib import Path

import numpy as np
from pandas import DataFrame

from brushexp.results.runs import gather
from brushexp.system.files import write_json, write_picture


def make_run(
    folder: Path, chosen: dict[str, str], *, name: str = "", target: int | None = None, color: int | None = None,
    size: tuple[int, int] = (20, 30), **noted: object,
) -> Path:  # fmt: skip
    """Write a run with overrides and metrics, and optionally a uniform grey target and painting."""
    run = folder / (name or str(len([path for path in folder.iterdir() if path.is_dir()])))
    run.mkdir(parents=True)
    write_words(run, *(f"{key}={value}" for key, value in chosen.items()))
    write_json(run / "metrics.json", {"status": "completed"} | noted)
    for picture, grey in (("target.png", target), ("painting.png", color)):
        if grey is not None:
            write_picture(run / picture, np.full((*size, 3), grey, np.uint8))
    return run


def make_grid(folder: Path, axes: dict[str, list[str]], **noted: object) -> None:
    """Write one run for each combination of values; run k reaches a PSNR of 20 + k dB in 2 + k seconds."""
    for k, values in enumerate(product(*axes.values())):
        numbers = {"psnr": 20.0 + k, "perceptual": 1 / (k + 2), "seconds": 2.0 + k}
        make_run(folder, dict(zip(axes, values, strict=True)), **(numbers | noted))


def write_words(run: Path, *words: str) -> None:
    """Write a run's overrides as Hydra does."""
    (run / ".hydra").mkdir(parents=True, exist_ok=True)
    write_json(run / ".hydra" / "overrides.yaml", words)  # JSON is a subset of YAML


def note(folder: Path, number: object, **noted: object) -> None:
    """Update the metrics of a run."""
    path = folder / str(number) / "metrics.json"
    write_json(path, json.loads(path.read_text()) | noted)


def collect(folder: Path) -> DataFrame:
    """Collect the runs of a sweep as its report does."""
    return gather([folder], folder)


def read_csv(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))
