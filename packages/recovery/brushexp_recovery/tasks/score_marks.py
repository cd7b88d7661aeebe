"""Compare strokes with marks drawn by people, for one picture or a folder of pictures."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp.contracts import UserError
from brushexp.contracts.files import as_shown, write_text
from brushexp.contracts.pictures import load_picture, picture_size, picture_suffixes
from brushexp.contracts.results import csv_table, markdown_table
from brushexp.contracts.strokes import CATALOGUE_NAME
from brushexp_recovery.benchmark.prediction_files import read_prediction
from brushexp_recovery.marks.mark_regions import pixels_of_mark
from brushexp_recovery.marks.mark_score import (
    LEVELS,
    Agreement,
    Counts,
    State,
    compare_regions,
    figures_of,
    judged_strokes,
)
from brushexp_recovery.marks.marks_file import MARKS_SUFFIX, Mark, Marks, is_marks, read_marks
from brushexp_recovery.measure.contours import outlines_of
from brushexp_recovery.page.marks_page import write_marks_page
from brushexp_recovery.raster.labels import group_pixels

log = logging.getLogger(__name__)

Array = NDArray[Any]

STROKES = (".json", ".h5", ".npz", ".npy", ".png")  # suffixes of files in a folder of strokes
ALL = "all"  # name of the row for all pictures
MEANING = (
    "A mark is found if a stroke overlaps it with an intersection over union of at least 0.5 (at .3: 0.3). A stroke "
    "without a mark is extra if it lies mostly on marks, or where every stroke is marked; between two people, all such "
    "strokes are extra. The intervals are 95 % bootstrap intervals over strokes."
)


@dataclass(frozen=True)
class Case:
    """The marks of one picture, and the path of the strokes to compare with them."""

    name: str
    marks: Marks
    strokes: Path
    picture: Path | None
    size: tuple[int, int]  # height and width


@dataclass(frozen=True)
class Comparison:
    """The comparison between the marks and the strokes of one picture."""

    case: Case
    agreement: Agreement
    between_people: bool

    def counts(self, end: str) -> Counts:
        """Return the counts at the level in `LEVELS` that has the suffix ``end``."""
        return self.agreement.scores[end].counts


def score_all_marks(truth: Path, strokes: Path, folder: Path, seed: int) -> dict[str, object]:
    """Compare strokes with marks, given as files or folders; write tables and pages, and return the overall scores."""
    cases = list_cases(truth, strokes)
    comparisons = [compare(case, folder, f"{case.name}.html") for case in cases]
    rows = [row_of(one.case.name, [one], seed) for one in comparisons]
    total = row_of(ALL, comparisons, seed)
    if len(cases) > 1:
        rows.append(total)
    write_text(folder / "scores.csv", csv_table(rows))
    write_text(folder / "scores.md", f"{MEANING}\n\n{markdown_table([round_row(row) for row in rows])}\n")
    for row in rows:
        log.info("%s", in_words(row))
    log.info("%s: scores.csv, scores.md, %s", as_shown(folder), ", ".join(f"{case.name}.html" for case in cases))
    return {name: value for name, value in total.items() if name != "picture"}


def list_cases(truth: Path, strokes: Path) -> list[Case]:
    """Pair mark files with stroke files, by name if they are in folders; raise UserError if a file is missing."""
    if not truth.is_dir():
        return [_case_of(truth, strokes / CATALOGUE_NAME if strokes.is_dir() else strokes)]
    files = [path for path in sorted(truth.glob(f"*{MARKS_SUFFIX}")) if is_marks(path)]
    if not files:
        raise UserError(f"truth={truth} has no marks; give a folder with marks as NAME.json")
    if not strokes.is_dir():
        raise UserError(
            f"truth={truth} is a folder, but strokes={strokes} is not; give a folder with NAME.json or NAME.h5"
        )
    return [_case_of(path, _strokes_for(path.stem, strokes)) for path in files]


def _strokes_for(name: str, folder: Path) -> Path:
    """Find the stroke file of a picture in a folder: NAME.json, NAME.h5, ..., or a run's NAME/catalogue.h5."""
    for path in (*(folder / f"{name}{suffix}" for suffix in STROKES), folder / name / CATALOGUE_NAME):
        if path.is_file():
            return path
    raise UserError(f"strokes={folder} has no strokes for {name}; write {name}.json or {name}/{CATALOGUE_NAME} there")


def _case_of(truth: Path, strokes: Path) -> Case:
    marks = read_marks(truth)
    beside = (truth.with_suffix(suffix) for suffix in sorted(picture_suffixes()))
    picture = marks.image or next((path for path in beside if path.is_file()), None)
    size = marks.size or (None if picture is None else picture_size(picture, key="truth"))
    if size is None and is_marks(strokes):
        size = read_marks(strokes).size
    if size is None:
        raise UserError(
            f"truth={truth} does not state the size of its picture; put the picture beside it, {truth.stem}.png, or "
            'add "size": [width, height]'
        )
    return Case(truth.stem, marks, strokes, picture, size)


def compare(case: Case, folder: Path, page: str) -> Comparison:
    """Compare the strokes of a case with its marks; write a table and a page showing both into a folder."""
    between_people = is_marks(case.strokes)
    marks = [pixels_of_mark(mark, case.size) for mark in case.marks.strokes]
    others = read_marks(case.strokes).strokes if between_people else []
    strokes = [pixels_of_mark(mark, case.size) for mark in others] if between_people else found_regions(case)
    everything = np.ones(len(strokes), bool)
    judged = everything if between_people else judged_strokes(case.marks, marks, strokes, case.size)
    agreement = compare_regions(marks, strokes, judged, case.size[0] * case.size[1])
    comparison = Comparison(case, agreement, between_people)
    score = agreement.scores[""]
    names = [mark.name for mark in case.marks.strokes]
    write_text(folder / f"{case.name}.csv", csv_table(mark_rows(names, agreement)))
    write_marks_page(
        folder / page,
        image=None if case.picture is None else load_picture(str(case.picture), None).permute(1, 2, 0).numpy(),
        size=case.size,
        name=case.name,
        marks=list(zip(names, score.marks, map(_outlines_for(case.size), case.marks.strokes), strict=True)),
        strokes=[
            (f"{number}", state, outlines)
            for number, (state, outlines) in enumerate(
                zip(score.strokes, _outlines_of_strokes(others, strokes, case.size), strict=True)
            )
        ],
        summary=in_words(row_of(case.name, [comparison], 0)),
        meaning=MEANING,
    )
    return comparison


def found_regions(case: Case) -> list[Array]:
    """Read the visible regions of a case's strokes as flat indices."""
    prediction = read_prediction(case.strokes, case.size)
    return [pixels.astype(np.int64) for pixels in group_pixels(prediction.labels, len(prediction))]


def _outlines_for(size: tuple[int, int]) -> Any:
    """Return a function that traces the outlines of a mark on a picture of the given size."""

    def trace(mark: Mark) -> Sequence[Array]:
        return mark.outlines or [_outline_of(pixels_of_mark(mark, size), size)]

    return trace


def _outlines_of_strokes(
    others: Sequence[Mark], strokes: Sequence[Array], size: tuple[int, int]
) -> list[Sequence[Array]]:
    """Trace the outlines of strokes, which are either another person's marks or regions given as flat indices."""
    if others:
        return [_outlines_for(size)(mark) for mark in others]
    return [[_outline_of(pixels, size)] for pixels in strokes]


def _outline_of(pixels: Array, size: tuple[int, int]) -> Array:
    """Trace the outline (P, 2) of the largest part of a region given as flat indices."""
    if not len(pixels):
        return np.empty((0, 2))
    rows, columns = np.divmod(pixels, size[1])
    top, left = rows.min(), columns.min()
    labels = np.full((rows.max() - top + 1, columns.max() - left + 1), -1, np.int32)
    labels[rows - top, columns - left] = 0
    return outlines_of(labels, 1)[0] + (left, top)


def mark_rows(names: Sequence[str], agreement: Agreement) -> list[dict[str, Any]]:
    """List the marks of a picture, each with its best overlap with a stroke and whether it was found."""
    columns = [agreement.scores[end].marks for end in LEVELS]
    return [
        {"mark": name, "best_iou": float(best), "at_5": str(hard), "at_3": str(soft)}
        for name, best, hard, soft in zip(names, agreement.best_iou, *columns, strict=True)
    ]


def row_of(name: str, comparisons: Sequence[Comparison], seed: int) -> dict[str, Any]:
    """Compute all scores of one picture, or of several pictures together."""
    best = np.concatenate([one.agreement.best_iou for one in comparisons])
    states = [state for one in comparisons for state in one.agreement.scores[""].strokes]
    row: dict[str, Any] = {
        "picture": name,
        "between": "people" if all(one.between_people for one in comparisons) else "marks and strokes",
        "truth": len(best),
        "predicted": len(states),
        "unjudged": states.count(State.UNJUDGED),
        "best_iou": float(best.mean()) if len(best) else float("nan"),
    }
    for end in LEVELS:
        counts = sum((one.counts(end) for one in comparisons), Counts(0, 0, 0))
        row |= figures_of(counts, end, seed)
    return row


def round_row(row: dict[str, Any]) -> dict[str, Any]:
    """Format the scores of a row for reading, with each rate and its interval in one cell."""
    short = {name: row[name] for name in ("picture", "between", "truth", "predicted", "unjudged")}
    for end, words in zip(LEVELS, ("", " at .3"), strict=True):
        for name in ("recall", "precision", "f1"):
            value, low, high = (row[f"{name}{end}{bound}"] for bound in ("", "_low", "_high"))
            short[name + words] = f"{value:.2f} ({low:.2f} to {high:.2f})" if np.isfinite(value) else None
    return short


def in_words(row: dict[str, Any]) -> str:
    """Summarise a row of scores in one line."""
    rates = [
        f"{word} {row[name]:.2f} ({row[f'{name}_low']:.2f} to {row[f'{name}_high']:.2f})"
        for name, word in (("recall", "recall"), ("precision", "precision"), ("f1", "F1"))
        if np.isfinite(row[name])
    ]
    people = "agreement of two people" if row["between"] == "people" else "strokes against marks"
    return (
        f"{row['picture']}, {people}: {', '.join(rates) or 'no marks'}; at .3 recall {row['recall_soft']:.2f}, "
        f"F1 {row['f1_soft']:.2f}; {row['predicted']} strokes for {row['truth']} marks"
    )
