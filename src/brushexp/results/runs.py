"""Finished runs, wherever they are, as one data frame; and the command that repeats each.

The frame has a row per run, indexed by its name, and columns in three parts:

- ``frame["run"]``: ``status`` and ``error``; ``folder``; ``picture``, the file that shows it, if there is one;
  ``target``, a fingerprint of what was painted; ``overrides`` as they were typed; ``anytime``, pairs of seconds and
  PSNR; ``command``, which repeats it; and of runs that are compared ``image``, the name of what was painted ("" of
  other tasks), and ``label``, the overrides by which it differs from the others of this image, seeds left out.
- ``frame["setting"]``: what was typed, a column per key, missing where it was not set; ``loss`` as names of losses.
- ``frame["metric"]``: every number (or name) that a run returned.
"""

from __future__ import annotations

import math
import os
import re
import shlex
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from brushexp.errors import UserError
from brushexp.pictures.decode import open_picture
from brushexp.results.tables import numbers
from brushexp.system.reading import digest_of, json_of, read_table, read_text, yaml_of
from brushexp.system.run_files import AT_WORK, METRICS_FILE, UNFINISHED

if TYPE_CHECKING:
    from pandas import DataFrame

Result = dict[str, Any]
JOBS = ".hydra/jobs.json"  # in the folder of a sweep: what was typed, and the words of each job
REMOVED = "(removed)"  # value of an override "~key"
TEXTS = ("status", "error", "loss", "picture")  # keys of a result that are words
LARGEST_NUMBER = 1e300
LONGEST_VALUE = 40  # letters of a value in a label; of a longer one the end is shown


def gather(folders: Iterable[Path], into: Path) -> DataFrame:
    """All runs at or below some folders, of sweeps in the order of the job numbers.

    A run's name is its folder as seen from ``into``, where their comparison is written. A folder without a run is a
    UserError.
    """
    into = into.resolve()
    results: dict[str, Result] = {}
    for folder in folders:
        if not folder.is_dir():
            raise UserError(f"runs={folder}: there is no such folder; give the folder of a run or of a sweep")
        paths = sorted(_runs_below(folder.resolve()), key=_place_of)
        if not paths:
            raise UserError(f"runs={folder}: there is no finished run in it; give the folder of a run or of a sweep")
        for path in paths:
            results[os.path.relpath(path, into)] = read_result(path)
    return frame_of(into, results)


def has_finished(folder: Path) -> bool:
    """Whether a run has come to its end, and written all its files: the status in its metrics.json says so last."""
    return (folder / METRICS_FILE).is_file() and read_result(folder)["status"] not in UNFINISHED


def has_ended(folder: Path) -> bool:
    """Whether a run has finished or failed, and was not killed or interrupted."""
    return (folder / METRICS_FILE).is_file() and read_result(folder)["status"] not in ("interrupted", AT_WORK)


def objective_in(result: Mapping[str, Any], name: str) -> float:
    """The number of a run's metrics.json that has this name; a UserError names the numbers of the run."""
    found = {key: float(value) for key, value in result.items() if type(value) in (int, float)}
    if name not in found:
        raise UserError(f"objective={name} is no number of this run; choose one of {', '.join(found)}")
    return found[name]


def frame_of(folder: Path, results: Mapping[str, Result]) -> DataFrame:
    """The data frame (see the top of this module) of what runs have noted, by name; each lies in ``folder / name``."""
    import pandas as pd  # noqa: PLC0415

    told = [_told(folder / name, result) for name, result in results.items()]
    losses = [{"loss": result["loss"]} if result.get("loss") else {} for result in results.values()]
    settings = [run["overrides"] | loss for run, loss in zip(told, losses, strict=True)]
    frame = pd.concat(
        {
            "run": _part(told, "image", "label"),
            "setting": _part(settings, "seed"),
            "metric": _part([_metrics(result) for result in results.values()], "psnr", "seconds"),
        },
        axis=1,
    ).set_axis(list(results))
    finished = ~frame["run", "status"].isin(UNFINISHED)
    painted = finished & numbers(frame)[["psnr", "seconds"]].notna().all(axis=1)
    images = frame[painted].groupby(frame["run", "target"], sort=False) if painted.any() else [("", frame[finished])]
    names = told_apart(image_name(alike["run"].iloc[0]) if target else "" for target, alike in images)
    for name, (_, alike) in zip(names, images, strict=True):
        seedless = [{k: v for k, v in one.items() if k != "seed"} for one in alike["run", "overrides"]]
        frame.loc[alike.index, ("run", "image")] = name
        frame.loc[alike.index, ("run", "label")] = [" ".join(parts) or "default" for parts in differences(seedless)]
    return frame


def told_apart(names: Iterable[str]) -> list[str]:
    """The names, those that were there before with a number: ``a``, ``b``, ``a (2)``."""
    before: Counter[str] = Counter()
    found = []
    for name in names:
        before[name] += 1
        found.append(name if before[name] == 1 else f"{name} ({before[name]})")
    return found


def differences(chosen: Sequence[Mapping[str, str]]) -> list[tuple[str, ...]]:
    """The overrides of each run by which it differs from the others: ``("steps=100", "~frames")``."""
    keys = dict.fromkeys(key for one in chosen for key in one)
    values = {key: list(dict.fromkeys(one.get(key, "") for one in chosen)) for key in keys}
    words = {key: shortened(found) for key, found in values.items() if len(found) > 1}
    return [
        tuple(f"~{key}" if one[key] == REMOVED else f"{key}={words[key][one[key]]}" for key in words if key in one)
        for one in chosen
    ]


def shortened(values: Sequence[str], longest: int = LONGEST_VALUE) -> dict[str, str]:
    """How each value of a setting is shown: paths without the folders that tell nothing, and not too long."""
    names = list(values)
    for depth in range(1, 1 + max(value.count("/") for value in values)):
        tails = [_tail(value, depth) for value in values]
        if len(set(tails)) == len(tails):
            names = tails
            break
    cut = [name if len(name) <= longest else "..." + name[-longest:] for name in names]
    return dict(zip(values, cut if len(set(cut)) == len(set(names)) else names, strict=True))


def _tail(value: str, depth: int) -> str:
    """So many parts of a path, from its end; a list keeps its bracket."""
    path = value.lstrip('["')
    return value.removesuffix(path) + "/".join(path.split("/")[-depth:])


def parse_overrides(words: Iterable[str]) -> dict[str, str]:
    """``["loss=mse", "+a=1", "~b"]`` as a dictionary."""
    pairs = (word.partition("=") for word in words)
    plain = ((key.lstrip("+~"), equals, re.sub(r'^"([^"\\]*)"$', r"\1", value)) for key, equals, value in pairs)
    return {key: value if equals else REMOVED for key, equals, value in plain}


def _part(rows: Sequence[Mapping[str, Any]], *always: str) -> DataFrame:
    """A column for every key of some row, and at least these."""
    import pandas as pd  # noqa: PLC0415

    columns = dict.fromkeys([*(key for row in rows for key in row), *always])
    return pd.DataFrame(rows, columns=list(columns), dtype=object)


def _told(folder: Path, result: Result) -> dict[str, Any]:
    """The columns of ``frame["run"]`` that tell of one run alone."""
    overrides = {key: value for key, value in result["overrides"].items() if key != "output"}
    picture, target = folder / Path(str(result.get("picture", "painting.png"))).name, folder / "target.png"
    asked = overrides.get("image"), overrides.get("resolution")
    return {
        "status": result["status"],
        "error": result.get("error"),
        "folder": folder,
        "picture": picture if picture.is_file() else None,
        "target": digest_of(target) if target.is_file() else str(asked),
        "overrides": overrides,
        "anytime": result.get("anytime"),
        "command": command_of(folder),
    }


def _metrics(result: Result) -> dict[str, Any]:
    """What a run has returned; what holds many numbers, a curve for instance, is no metric."""
    metrics = {k: v for k, v in result.items() if k not in (*TEXTS, "overrides") and not isinstance(v, list | dict)}
    if metrics.get("psnr") is None and metrics.get("l1") == 0:
        metrics["psnr"] = math.inf  # which JSON does not know
    return metrics


def command_of(folder: Path) -> str:
    """What repeats a run: its overrides without its folder; a study that is a sweep then runs once."""
    typed = words_of(folder)
    single = ["hydra.mode=RUN"] * any(word.startswith(("experiment=", "+experiment=")) for word in typed)
    return shlex.join(["brushexp", *(word for word in typed if not word.startswith("output=")), *single])


def words_of(folder: Path) -> list[str]:
    """The overrides of a run as they were typed, none if they were not kept."""
    try:
        return [str(word) for word in yaml_of(read_text(folder / ".hydra" / "overrides.yaml", ""), list)]
    except UserError:
        return []


def image_name(run: Any) -> str:
    """Name and size of what a run painted, as far as they are known."""
    name = Path(str(setting_of(run, "image") or "picture")).name
    with suppress(UserError), open_picture(run["folder"] / "target.png") as picture:
        return f"{name}, {picture.width} x {picture.height} pixels"
    return name


def setting_of(run: Any, key: str) -> Any:
    """The value of a key, as it was typed or as its config has it; None if neither is known."""
    if key in run["overrides"]:
        return run["overrides"][key]
    with suppress(UserError):
        return yaml_of(read_text(run["folder"] / ".hydra" / "config.yaml", "")).get(key)
    return None


def _runs_below(folder: Path) -> Iterator[Path]:
    """Folders with a result, but not what is inside of them."""
    for path, folders, files in os.walk(folder):
        if METRICS_FILE in files:
            yield Path(path)
            folders.clear()


def read_result(folder: Path) -> Result:
    """The metrics.json of a run, of the kinds of values that runs write, and its overrides; failed if unreadable."""
    overrides, data = parse_overrides(words_of(folder)), None
    with suppress(UserError):
        data = json_of(read_text(folder / METRICS_FILE, ""))
    if not isinstance(data, dict):
        return {"status": "failed", "error": f"its {METRICS_FILE} cannot be read", "overrides": overrides}
    plain = {key: _measured(value) for key, value in data.items() if not isinstance(value, list | dict)}
    texts = {key: str(data[key]) for key in TEXTS if data.get(key) is not None}
    return {"status": "completed", **plain, **texts, "overrides": overrides, "anytime": data.get("anytime")}


def read_curves(path: Path) -> dict[str, list[float]]:
    """The columns of a table of curves, NaN where there is nothing; none if it is not there or no table."""
    rows = read_table(path)
    return {name: [_float(row[name]) for row in rows] for name in (rows[0] if rows else ())}


def _float(text: str | None) -> float:
    try:
        return float(text or "nan")
    except ValueError:
        return math.nan


def _measured(value: Any) -> Any:
    """A value, but None for a number that is not finite or too large to be one that was measured."""
    return None if isinstance(value, int | float) and not abs(value) < LARGEST_NUMBER else value


def _place_of(run: Path) -> tuple[str, bool, int, str]:
    """Puts the runs of a folder in the order of their numbers, and those without one behind."""
    return str(run.parent), not run.name.isdecimal(), int(run.name) if run.name.isdecimal() else 0, run.name
