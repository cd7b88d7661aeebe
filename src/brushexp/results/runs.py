"""Finished runs, wherever they are, by picture and settings; and the command that repeats each."""

from __future__ import annotations

import json
import os
import shlex
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf
from PIL import Image

from brushexp.errors import UserError
from brushexp.results.drawing import UNREADABLE
from brushexp.results.table import Result, fingerprint, finished, numbers, read_result, run_number, shortened

NO_SETTINGS = ("seed", "output")  # keys that say nothing about how a picture is painted
REMOVED = "(removed)"  # value of an override "~key"


@dataclass(frozen=True)
class Setting:
    """Runs of one picture that differ in the seed alone.

    Attributes:
        parts: overrides by which it differs from the others, "steps=100" for instance; none: the default.
        command: what repeats the first of the runs.
        runs: at least one.
    """

    parts: tuple[str, ...]
    command: str
    runs: list[Result]

    @property
    def label(self) -> str:
        """The overrides on one line."""
        return " ".join(self.parts) or "default"


@dataclass(frozen=True)
class Picture:
    """What was painted, and how; numbers of different pictures are never compared."""

    name: str
    settings: list[Setting]


def overrides(words: Iterable[str]) -> dict[str, str]:
    """``["loss=mse", "+a=1", "~b"]`` as a dictionary."""
    pairs = (word.partition("=") for word in words)
    return {key.lstrip("+~"): value if equals else REMOVED for key, equals, value in pairs}


def gather(folders: Iterable[Path], into: Path) -> list[Result]:
    """The results of all runs at or below some folders: of sweeps, of single runs, or above many of either.

    Args:
        folders: where to look.
        into: the folder in which their comparison is written; ``run`` of each result is its folder as seen from there.

    Raises:
        UserError: if there is no run in one of them.
    """
    into = into.resolve()
    found: dict[str, Result] = {}
    for folder in folders:
        if not folder.is_dir():
            raise UserError(f"runs={folder}: there is no such folder; give the folder of a run or of a sweep")
        paths = sorted(_runs_below(folder.resolve()), key=lambda path: (str(path.parent), run_number(path.name)))
        if not paths:
            raise UserError(f"runs={folder}: there is no finished run in it; give the folder of a run or of a sweep")
        for path in paths:
            run = os.path.relpath(path, into)
            result = _result_of(path)
            chosen = {key: value for key, value in result["overrides"].items() if key != "output"}
            found[run] = result | {"run": run, "overrides": chosen}
    return list(found.values())


def paintings(results: Iterable[Result]) -> list[Result]:
    """The finished runs of which seconds and PSNR are known."""
    return [run for run in finished(results) if numbers([run], "psnr") and numbers([run], "seconds")]


def by_picture(folder: Path, results: Iterable[Result]) -> list[Picture]:
    """The runs by what they painted, pixel by pixel, and how.

    Args:
        folder: each run's folder is ``folder / run["run"]``.
        results: of runs.
    """
    targets: dict[str, list[Result]] = {}
    for run in results:
        targets.setdefault(_target_of(folder, run), []).append(run)
    pictures: list[Picture] = []
    for runs in targets.values():
        name = _name_of(folder, runs[0])
        same = sum(picture.name.partition(" (")[0] == name for picture in pictures)
        pictures.append(Picture(f"{name} ({same + 1})" if same else name, by_settings(folder, runs)))
    return pictures


def by_settings(folder: Path, runs: list[Result]) -> list[Setting]:
    """The runs by their overrides, the seed left out, in order of first appearance."""
    groups: dict[tuple[tuple[str, str], ...], list[Result]] = {}
    for run in runs:
        chosen = {key: value for key, value in run.get("overrides", {}).items() if key not in NO_SETTINGS}
        groups.setdefault(tuple(sorted(chosen.items())), []).append(run)
    keys = dict.fromkeys(key for run in runs for key in run.get("overrides", {}))
    values = {key: list(dict.fromkeys(dict(group).get(key, "") for group in groups)) for key in keys}
    words = {key: shortened(found) for key, found in values.items() if len(found) > 1}
    settings = []
    for group, alike in groups.items():
        chosen = dict(group)
        parts = (_part(key, chosen[key], names[chosen[key]]) for key, names in words.items() if key in chosen)
        settings.append(Setting(tuple(parts), command_of(folder / alike[0]["run"], alike[0]), alike))
    return settings


def command_of(folder: Path, result: Result) -> str:
    """What repeats a run: its overrides without its folder; a study that is a sweep then runs once."""
    words = _words_of(folder, result)
    single = ["hydra.mode=RUN"] * any(word.startswith(("experiment=", "+experiment=")) for word in words)
    kept = [word for word in words if not word.startswith("output=")]
    return shlex.join(["python", "run.py", *kept, *single])


def _runs_below(folder: Path) -> Iterator[Path]:
    """Folders with a result, but not what is inside of them."""
    for path, folders, files in os.walk(folder):
        if "result.json" in files or "metrics.json" in files:
            yield Path(path)
            folders.clear()


def _result_of(run: Path) -> Result:
    """What a sweep has noted of a run; of a single run its metrics and overrides."""
    if (run / "result.json").is_file():
        return read_result(run / "result.json")
    result = read_result(run / "metrics.json")
    return result | {"overrides": overrides(_words_of(run, result))}


def _words_of(run: Path, result: Result) -> list[str]:
    """The overrides of a run as they were typed."""
    try:
        words = OmegaConf.to_container(OmegaConf.load(run / ".hydra" / "overrides.yaml"))
        return [str(word) for word in words] if isinstance(words, list) else []
    except OSError:
        pairs = result.get("overrides", {}).items()
        return [f"~{key}" if value == REMOVED else f"{key}={value}" for key, value in pairs]


def _part(key: str, value: str, shown: str) -> str:
    return f"~{key}" if value == REMOVED else f"{key}={shown}"


def _target_of(folder: Path, run: Result) -> str:
    """Which picture it was, told by its pixels; by what was typed if they were not kept."""
    path = folder / run["run"] / "target.png"
    if path.is_file():
        return fingerprint(path)
    chosen = run.get("overrides", {})
    return json.dumps([chosen.get("image"), chosen.get("resolution")])


def _name_of(folder: Path, run: Result) -> str:
    """Name and size of a picture, as far as they are known."""
    path = folder / run["run"]
    name: Any = run.get("overrides", {}).get("image")
    if name is None and (path / ".hydra" / "config.yaml").is_file():
        config = OmegaConf.load(path / ".hydra" / "config.yaml")
        name = config.get("image") if isinstance(config, DictConfig) else None
    name = Path(str(name or "picture")).name
    try:
        with Image.open(path / "target.png") as picture:
            return f"{name}, {picture.width} x {picture.height} pixels"
    except UNREADABLE:
        return name
