"""Gather finished runs into one data frame.

The frame has one row per run, indexed by the run's name, and three groups of columns:

- ``frame["run"]``: ``status``; ``error``; ``folder``; ``picture``, the path of the run's picture or None; ``target``, a
  fingerprint of the target picture; ``overrides`` as typed; ``anytime``, pairs of seconds and PSNR; ``provenance``,
  None for old runs; ``command``, which repeats the run. Finished runs also have ``image``, the name and size of the
  target picture ("" for tasks that do not paint), and ``label``, the overrides (except seeds) that distinguish the run
  from others of the same image.
- ``frame["setting"]``: one column per key set on any command line, missing for runs that did not set it; ``loss`` holds
  the names of the losses.
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
from brushexp.system.run_files import METRICS_FILE
from brushexp.system.status import UNFINISHED, Status

if TYPE_CHECKING:
    from pandas import DataFrame

Result = dict[str, Any]
JOBS = ".hydra/jobs.json"  # file in the folder of a sweep that contains the typed words and those of each job
REMOVED = "(removed)"  # value of an override "~key"
TEXTS = ("status", "error", "loss", "picture", "verdict")  # entries of a result that are text
LARGEST_NUMBER = 1e300  # larger numbers in a result count as missing
LONGEST_VALUE = 40  # characters of a value in a label; longer values lose their beginning


def gather(folders: Iterable[Path], into: Path) -> DataFrame:
    """Gather all runs in or below the given folders, sorted by job number, with names relative to ``into``.

    Raises a UserError for a folder without runs.
    """
    into = into.resolve()
    results: dict[str, Result] = {}
    for folder in folders:
        paths = sorted(_runs_below(folder.resolve()), key=_job_order)
        if not paths:
            reason = "no finished run" if folder.is_dir() else "no such folder"
            raise UserError(f"runs={folder}: there is {reason}; give the folder of a run or of a sweep")
        results |= {os.path.relpath(path, into): read_result(path) for path in paths}
    return frame_of(into, results)


def has_finished(folder: Path) -> bool:
    """Check whether a run has finished successfully and written all its files."""
    return (folder / METRICS_FILE).is_file() and read_result(folder)["status"] not in UNFINISHED


def has_ended(folder: Path) -> bool:
    """Check whether a run finished or failed, as opposed to being killed or interrupted."""
    goes_on = (Status.INTERRUPTED, Status.AT_WORK)
    return (folder / METRICS_FILE).is_file() and read_result(folder)["status"] not in goes_on


def objective_in(result: Mapping[str, Any], name: str) -> float:
    """Return the number called ``name`` in a run's result; if it is missing, raise a UserError listing the choices."""
    values = {key: float(value) for key, value in result.items() if type(value) in (int, float)}
    if name not in values:
        raise UserError(f"objective={name} is not a metric of this run; choose one of {', '.join(values)}")
    return values[name]


def frame_of(folder: Path, results: Mapping[str, Result]) -> DataFrame:
    """Make the data frame that the module's docstring describes; ``results`` are those of the runs in ``folder``."""
    import pandas as pd  # noqa: PLC0415

    runs = [_run_columns(folder / name, result) for name, result in results.items()]
    losses = [{"loss": result["loss"]} if result.get("loss") else {} for result in results.values()]
    settings = [run["overrides"] | loss for run, loss in zip(runs, losses, strict=True)]
    metrics = [_metrics(result) for result in results.values()]
    parts = [_part(runs, "image", "label"), _part(settings, "seed"), _part(metrics, "psnr", "seconds")]
    frame = pd.concat(parts, axis=1, keys=["run", "setting", "metric"]).set_axis(list(results))
    finished = ~frame["run", "status"].isin(UNFINISHED)
    painted = finished & numbers(frame)[["psnr", "seconds"]].notna().all(axis=1)
    images = frame[painted].groupby(frame["run", "target"], sort=False) if painted.any() else [("", frame[finished])]
    names = make_unique(image_name(alike["run"].iloc[0]) if target else "" for target, alike in images)
    for name, (_, alike) in zip(names, images, strict=True):
        seedless = [{k: v for k, v in one.items() if k != "seed"} for one in alike["run", "overrides"]]
        frame.loc[alike.index, ("run", "image")] = name
        frame.loc[alike.index, ("run", "label")] = [" ".join(parts) or "default" for parts in differences(seedless)]
    return frame


def make_unique(names: Iterable[str]) -> list[str]:
    """Number repeated names: ``a``, ``b``, ``a (2)``."""
    counts: Counter[str] = Counter()
    unique = []
    for name in names:
        counts[name] += 1
        unique.append(name if counts[name] == 1 else f"{name} ({counts[name]})")
    return unique


def differences(chosen: Sequence[Mapping[str, str]]) -> list[tuple[str, ...]]:
    """List the overrides that distinguish each run from the others: ``("steps=100", "~frames")``."""
    keys = dict.fromkeys(key for one in chosen for key in one)
    values = {key: list(dict.fromkeys(one.get(key, "") for one in chosen)) for key in keys}
    words = {key: shorten(several) for key, several in values.items() if len(several) > 1}
    return [
        tuple(f"~{key}" if one[key] == REMOVED else f"{key}={words[key][one[key]]}" for key in words if key in one)
        for one in chosen
    ]


def shorten(values: Sequence[str], longest: int = LONGEST_VALUE) -> dict[str, str]:
    """Shorten a setting's values by keeping only the ends of paths and of long values, if the results are distinct."""
    depths = range(1, 1 + max(value.count("/") for value in values))
    tails = ([_tail(value, depth) for value in values] for depth in depths)
    names = next((names for names in tails if len(set(names)) == len(names)), list(values))
    cut = [name if len(name) <= longest else "..." + name[-longest:] for name in names]
    return dict(zip(values, cut if len(set(cut)) == len(set(names)) else names, strict=True))


def _tail(value: str, depth: int) -> str:
    """Shorten a path to its last ``depth`` parts; if the value is a list, its opening bracket is kept."""
    path = value.lstrip('["')
    return value.removesuffix(path) + "/".join(path.split("/")[-depth:])


def parse_overrides(words: Iterable[str]) -> dict[str, str]:
    """Parse overrides such as ``["loss=mse", "+a=1", "~b"]`` into a dictionary."""
    pairs = (word.partition("=") for word in words)
    plain = ((key.lstrip("+~"), equals, re.sub(r'^"([^"\\]*)"$', r"\1", value)) for key, equals, value in pairs)
    return {key: value if equals else REMOVED for key, equals, value in plain}


def _part(rows: Sequence[Mapping[str, Any]], *always: str) -> DataFrame:
    """Make a frame with a column for each key that occurs in a row, and for each key in ``always``."""
    import pandas as pd  # noqa: PLC0415

    columns = dict.fromkeys([*(key for row in rows for key in row), *always])
    return pd.DataFrame(rows, columns=list(columns), dtype=object)


def _run_columns(folder: Path, result: Result) -> dict[str, Any]:
    overrides = {key: value for key, value in result["overrides"].items() if key != "output"}
    picture, target = folder / Path(str(result.get("picture", "painting.png"))).name, folder / "target.png"
    typed = overrides.get("image"), overrides.get("resolution")
    return {key: result.get(key) for key in ("status", "error", "anytime", "provenance")} | {
        "folder": folder,
        "picture": picture if picture.is_file() else None,
        "target": digest_of(target) if target.is_file() else str(typed),
        "overrides": overrides,
        "command": command_of(folder),
    }


def _metrics(result: Result) -> dict[str, Any]:
    metrics = {k: v for k, v in result.items() if k not in (*TEXTS, "overrides") and not isinstance(v, list | dict)}
    if metrics.get("psnr") is None and metrics.get("l1") == 0:
        metrics["psnr"] = math.inf  # JSON has no infinity
    return metrics


def command_of(folder: Path) -> str:
    """Return the command that repeats a run in a new folder; for a job of a study, it repeats only that job."""
    typed = words_of(folder)
    single = ["hydra.mode=RUN"] * any(word.startswith(("experiment=", "+experiment=")) for word in typed)
    return shlex.join(["brushexp", *(word for word in typed if not word.startswith("output=")), *single])


def words_of(folder: Path) -> list[str]:
    """Return the overrides of a run as typed, or an empty list if they were not recorded."""
    try:
        return [str(word) for word in yaml_of(read_text(folder / ".hydra" / "overrides.yaml", ""), list)]
    except UserError:
        return []


def look_of(folder: Path) -> str:
    """Return the name of a run's look as Hydra recorded it, or "" if there is no record."""
    try:
        recorded: Any = yaml_of(read_text(folder / ".hydra" / "hydra.yaml", ""))
    except UserError:
        return ""
    for key in ("hydra", "runtime", "choices"):
        recorded = recorded.get(key) if isinstance(recorded, dict) else None
    return str(recorded.get("look", "")) if isinstance(recorded, dict) else ""


def image_name(run: Any) -> str:
    """Return the file name of the target picture, with its size if the run folder holds the target."""
    name = Path(str(setting_of(run, "image") or "picture")).name
    with suppress(UserError), open_picture(run["folder"] / "target.png") as picture:
        return f"{name}, {picture.width} x {picture.height} pixels"
    return name


def setting_of(run: Any, key: str) -> Any:
    """Return the value of a key as typed, or else its value in the run's config, or None if there is neither."""
    if key in run["overrides"]:
        return run["overrides"][key]
    with suppress(UserError):
        return yaml_of(read_text(run["folder"] / ".hydra" / "config.yaml", "")).get(key)
    return None


def _runs_below(folder: Path) -> Iterator[Path]:
    for path, folders, files in os.walk(folder):
        if METRICS_FILE in files:
            yield Path(path)
            folders.clear()


def read_result(folder: Path) -> Result:
    """Read a run's metrics.json and its overrides; the run counts as failed if metrics.json cannot be read."""
    overrides, data = parse_overrides(words_of(folder)), None
    with suppress(UserError):
        data = json_of(read_text(folder / METRICS_FILE, ""))
    if not isinstance(data, dict):
        return {"status": Status.FAILED, "error": f"its {METRICS_FILE} cannot be read", "overrides": overrides}
    plain = {key: _value(value) for key, value in data.items() if not isinstance(value, list | dict)}
    texts = {key: str(data[key]) for key in TEXTS if data.get(key) is not None}
    nested = {key: data.get(key) for key in ("anytime", "provenance")}
    return {"status": Status.COMPLETED, **plain, **texts, **nested, "overrides": overrides}


def read_curves(path: Path) -> dict[str, list[float]]:
    """Read a table of curves as columns, with NaN for missing numbers; return {} if there is no table."""
    rows = read_table(path)
    return {name: [_float(row[name]) for row in rows] for name in (rows[0] if rows else ())}


def _float(text: str | None) -> float:
    try:
        return float(text or "nan")
    except ValueError:
        return math.nan


def _value(value: Any) -> Any:
    """Replace a number with None if it is too large or not finite."""
    return None if isinstance(value, int | float) and not abs(value) < LARGEST_NUMBER else value


def _job_order(run: Path) -> tuple[str, bool, int, str]:
    return str(run.parent), not run.name.isdecimal(), int(run.name) if run.name.isdecimal() else 0, run.name
