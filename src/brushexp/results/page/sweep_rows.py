"""What the page of a sweep shows of its runs: what varies, how each ended, its numbers, its picture, its command."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path, PurePath
from urllib.parse import quote

from brushexp.results.anytime import ahead, curve_of, curves_of
from brushexp.results.effect import HIGHER_IS_BETTER
from brushexp.results.page.thumbnails import Thumbnail, side_for, thumbnail
from brushexp.results.plotting import NAMES
from brushexp.results.runs import REMOVED, Picture, by_picture, by_settings, command_of, paintings
from brushexp.results.table import (
    DIGITS,
    Result,
    fingerprint,
    finished,
    formatted,
    numbers,
    picture_of,
    settings,
    shortened,
    varying,
)

MOST_COLUMNS = 4  # settings with a column each; of more, each run tells those that were set
HIGHER = (*HIGHER_IS_BETTER, "accuracy", "auc", "strokes_per_second", "strokes_per_second_backward")
NOT_JUDGED = ("n_strokes", "parameters", "file_mb")  # metrics of which neither more nor less is better
OTHER_NAMES = {"n_strokes": "strokes painted"}  # "strokes" is the setting
NOT_SET = "not set"
FOLDER = "output"  # key that says nothing about a run
ENDED = "status"  # no setting has this name
PLACES = 4  # digits after the point of a curve's numbers


@dataclass(frozen=True)
class Metric:
    """A number that some run has.

    Attributes:
        key: in ``result.json``.
        name: for people.
        digits: after the point.
        better: "higher", "lower" or "".
    """

    key: str
    name: str
    digits: int
    better: str


@dataclass(frozen=True)
class Row:
    """A run.

    Attributes:
        name: what it is called: its number, or the end of the path to it.
        label: the overrides by which it differs from the others, on one line.
        status: how it ended.
        error: why it failed, or "".
        chosen: the value of each setting that varies, as the command line had it; "" where it was not set.
        parts: the overrides among these, as they are shown: ``("steps=100",)``.
        cells: of each metric what is written.
        numbers: of each metric that it has, the number.
        command: what repeats it.
        report: address of its own page as seen from this one, "" if it has none.
        picture: what it is shown by, if there is any.
        target: number of what it painted among the targets of the page; None if that was not kept.
        group: number of its setting among those of the page, seeds left out; None if it is not compared.
        curve: pairs of seconds and PSNR.
    """

    name: str
    label: str
    status: str
    error: str
    chosen: dict[str, str]
    parts: tuple[str, ...]
    cells: dict[str, str]
    numbers: dict[str, float]
    command: str
    report: str
    picture: Thumbnail | None
    target: int | None
    group: int | None
    curve: list[list[float]]


@dataclass(frozen=True)
class Group:
    """Runs that differ in the seed alone.

    Attributes:
        label: overrides by which it differs from the others of the same picture.
        picture: number of what was painted among the pictures of the page; numbers of two are never compared.
        ahead_from: seconds from which on it was ahead of the others for the last time; None if it never was.
    """

    label: str
    picture: int
    ahead_from: float | None


@dataclass(frozen=True)
class Target:
    """What was painted: its name, "target" at least, and the picture unless it cannot be read."""

    name: str
    picture: Thumbnail | None


@dataclass(frozen=True)
class Rows:
    """All that the page shows.

    Attributes:
        axes: what varies, and the values of each: as the command line had it -> as it is shown.
        same: settings that all runs share.
        metrics: numbers that some run has.
        rows: the runs.
        groups: of runs that differ in the seed alone.
        pictures: names of what was painted.
        targets: what was painted.
        side: pixels: longer side of a picture of the page, at most.
    """

    axes: dict[str, dict[str, str]]
    same: dict[str, str]
    metrics: list[Metric]
    rows: list[Row]
    groups: list[Group]
    pictures: list[str]
    targets: list[Target]
    side: int

    @property
    def filters(self) -> dict[str, dict[str, str]]:
        """What the runs can be chosen by: what varies, and how they ended if that differs."""
        ends = {row.status: row.status for row in self.rows}
        return self.axes | ({ENDED: ends} if len(ends) > 1 else {})

    @property
    def in_columns(self) -> bool:
        """Whether each setting that varies has a column of its own."""
        return len(self.axes) <= MOST_COLUMNS


def rows_of(folder: Path, results: list[Result]) -> Rows:
    """Everything about some runs.

    Args:
        folder: where the page will lie; each run's folder is ``folder / run["run"]``.
        results: of runs.
    """
    axes = {key: shortened(values) for key, values in varying(results).items() if key != FOLDER}
    metrics = [_metric(key) for key in DIGITS if any(key in result for result in results)]
    shown = {result["run"]: path for result in results if (path := picture_of(folder, result)).is_file()}
    numbered, targets = _targets(folder, results)
    side = side_for(len(shown) + len(targets))
    groups, pictures, places, commands = _groups(folder, results)
    known = {numbered[run]: pictures[groups[k].picture] for run, k in places.items() if run in numbered}
    names = shortened([_address(result["run"]) for result in results])
    rows = []
    for result in results:
        run = result["run"]
        picture = thumbnail(shown[run], side) if run in shown else None
        name = names[_address(run)]
        command = commands.get(run) or command_of(folder / run, result)
        rows.append(_row(folder, result, axes, metrics, name, command, picture, numbered.get(run), places.get(run)))
    return Rows(
        axes={key: {value: name or NOT_SET for value, name in words.items()} for key, words in axes.items()},
        same=_same(results),
        metrics=metrics,
        rows=rows,
        groups=groups,
        pictures=pictures,
        targets=[
            Target(f"target: {known[k]}" if known.get(k) else "target", thumbnail(path, side))
            for k, path in enumerate(targets)
        ],
        side=side,
    )


def _metric(key: str) -> Metric:
    better = "higher" if key in HIGHER else "" if key in NOT_JUDGED else "lower"
    return Metric(key, NAMES.get(key) or OTHER_NAMES.get(key) or key.replace("_", " "), DIGITS[key], better)


def _row(
    folder: Path, result: Result, axes: dict[str, dict[str, str]], metrics: list[Metric], name: str,
    command: str, picture: Thumbnail | None, target: int | None, group: int | None,
) -> Row:  # fmt: skip
    parts = _parts(result, axes)
    chosen = settings(result)
    found = {metric.key: numbers([result], metric.key) for metric in metrics}
    return Row(
        name=name,
        label=" ".join(parts) or "default",
        status=str(result["status"]),
        error=str(result.get("error", "")) if result["status"] == "failed" else "",
        chosen={key: chosen.get(key, "") for key in axes},
        parts=parts,
        cells={metric.key: formatted(result, metric.key) for metric in metrics},
        numbers={key: float(one[0]) for key, one in found.items() if one and math.isfinite(one[0])},
        command=command,
        report=_report(folder, result),
        picture=picture,
        target=target,
        group=group,
        curve=_curve(result),
    )


def _parts(result: Result, axes: dict[str, dict[str, str]]) -> tuple[str, ...]:
    """The overrides of a run among what varies, as they are shown."""
    chosen = result.get("overrides", {})
    names = {key: axes[key].get(chosen[key], chosen[key]) for key in axes if key in chosen}
    return tuple(f"~{key}" if chosen[key] == REMOVED else f"{key}={name}" for key, name in names.items())


def _same(results: list[Result]) -> dict[str, str]:
    """What the command lines of all runs said alike, their folder left out."""
    others = varying(results)
    return {key: value for key, value in settings(results[0]).items() if key not in others and key != FOLDER}


def _targets(folder: Path, results: list[Result]) -> tuple[dict[str, int], list[Path]]:
    """What was painted, each picture once; and the number of each run's."""
    seen: dict[str, int] = {}
    numbered: dict[str, int] = {}
    paths: list[Path] = []
    for result in results:
        path = folder / result["run"] / "target.png"
        if path.is_file():
            k = numbered[result["run"]] = seen.setdefault(fingerprint(path), len(seen))
            if k == len(paths):
                paths.append(path)
    return numbered, paths


def _groups(folder: Path, results: list[Result]) -> tuple[list[Group], list[str], dict[str, int], dict[str, str]]:
    """The runs that can be compared: their groups, names of what they painted, the group of each, some commands."""
    pictures = by_picture(folder, paintings(results)) or [Picture("", by_settings(folder, finished(results)))]
    found: list[Group] = []
    places: dict[str, int] = {}
    commands = {}
    for k, picture in enumerate(pictures):
        curves = curves_of(picture)
        leaders = {label: seconds for seconds, label in ahead(curves)} if curves else {}
        for setting in picture.settings:
            places |= {run["run"]: len(found) for run in setting.runs}
            commands[setting.runs[0]["run"]] = setting.command
            found.append(Group(setting.label, k, leaders.get(setting.label)))
    return found, [picture.name for picture in pictures], places, commands


def _address(run: str) -> str:
    return PurePath(run).as_posix()


def _report(folder: Path, result: Result) -> str:
    """Address of a run's own page as seen from this one, quoted, so that it is no address of another kind."""
    page = PurePath(result["run"]) / "report.html"
    return quote(page.as_posix(), errors="surrogateescape") if (folder / page).is_file() else ""


def _curve(result: Result) -> list[list[float]]:
    curve = curve_of(result)
    if curve is None:
        return []
    return [[round(float(x), PLACES), round(float(y), PLACES)] for x, y in zip(*curve, strict=True)]
