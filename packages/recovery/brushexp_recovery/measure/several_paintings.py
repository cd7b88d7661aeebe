"""Tabulate several measured paintings with their intervals, and test for differences between groups.

Each group is named after the folder that contains the photographs of its paintings. Groups are compared measure by
measure: a permutation test is applied to the difference between their means, with one value per painting, and the
p-values of all tests are corrected together (Holm, 1979).
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import comb
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from brushexp.contracts.files import write_text
from brushexp.contracts.results import PageTable, RunComparison, csv_table, holm, latex_table, markdown_table
from brushexp_recovery.measure.areas import WHOLE
from brushexp_recovery.measure.figure_tables import format_number
from brushexp_recovery.measure.measures import MEASURES

if TYPE_CHECKING:
    from pandas import DataFrame

Array = NDArray[Any]

MEASURES_FILE = "measures.json"
ON_PAGE = ("strokes", "covered", "length", "width", "elongatedness", "direction", "coherence")
LEAST_PAINTINGS = 2  # minimum number of paintings in a compared group
DRAWS = 9999  # maximum number of permutations
SIGNIFICANT = 0.05  # corrected p-value below which groups differ
MEANING = (
    "Each figure has a 90 % interval. Groups are the folders of the photographs. p comes from a "
    "permutation test of the difference of their means, with one value per painting; p (Holm) is corrected for all "
    "tests of the table. Beside it is the smallest p that this many paintings can reach. Directions are not tested."
)


@dataclass(frozen=True)
class Painting:
    """The measured values of one painting."""

    name: str
    group: str
    figures: Mapping[str, Mapping[str, Any]]  # by `MEASURES`: unit, value, low and high; numbers may be None


def paintings_of(frame: "DataFrame") -> list[Painting]:
    """Read the measured values of all ``task=measure`` runs in a data frame of runs."""
    if ("setting", "image") not in frame.columns:
        return []
    paintings = []
    for folder, image in zip(frame["run", "folder"], frame["setting", "image"], strict=True):
        path = Path(folder) / MEASURES_FILE
        if not path.is_file() or not isinstance(image, str):
            continue
        figures = json.loads(path.read_text(encoding="utf-8"))["measures"].get(WHOLE, {})
        photograph = Path(image.strip('"'))
        paintings.append(Painting(photograph.name, photograph.parent.name, figures))
    return paintings


def figure_rows(paintings: Sequence[Painting]) -> list[dict[str, Any]]:
    """List all measured values of all paintings, one per row."""
    return [
        {
            "painting": painting.name,
            "group": painting.group,
            "measure": MEASURES[name].name,
            "unit": figure["unit"],
            **{bound: figure[bound] for bound in ("value", "low", "high")},
        }
        for painting in paintings
        for name, figure in painting.figures.items()
    ]


def painting_rows(paintings: Sequence[Painting]) -> list[dict[str, Any]]:
    """List the paintings, one per row, with the most informative values and their intervals as text."""
    rows = []
    for painting in paintings:
        row: dict[str, Any] = {"painting": painting.name, "group": painting.group}
        for name in ON_PAGE:
            figure = painting.figures[name]
            numbers = [None if figure[key] is None else format_number(figure[key]) for key in ("value", "low", "high")]
            head = f"{MEASURES[name].name}, {figure['unit']}" if figure["unit"] else MEASURES[name].name
            row[head] = None if None in numbers else "{} ({} to {})".format(*numbers)
        rows.append(row)
    heads = dict.fromkeys(head for row in rows for head in row)
    return [{head: row.get(head) for head in heads} for row in rows]


def group_rows(paintings: Sequence[Painting], seed: int = 0) -> list[dict[str, Any]]:
    """Compare each pair of groups in all measures with a common unit, except directions; sort the rows by p-value."""
    groups: dict[str, list[Painting]] = {}
    for painting in paintings:
        groups.setdefault(painting.group, []).append(painting)
    large = {name: group for name, group in groups.items() if len(group) >= LEAST_PAINTINGS}
    random = np.random.default_rng(seed)
    rows = []
    for (one, first), (other, second) in combinations(large.items(), 2):
        for name, measure in MEASURES.items():
            units = {painting.figures[name]["unit"] for painting in (*first, *second)}
            if measure.axial or len(units) > 1:
                continue
            values = [_values_of(group, name) for group in (first, second)]
            if min(map(len, values)) < LEAST_PAINTINGS:
                continue
            means = [float(value.mean()) for value in values]
            rows.append(
                {
                    "measure": measure.name,
                    "unit": units.pop(),
                    "first": f"{one} ({len(values[0])})",
                    "second": f"{other} ({len(values[1])})",
                    "mean of first": format_number(means[0]),
                    "mean of second": format_number(means[1]),
                    "p": permutation_p(values[0], values[1], random),
                    "least p": least_p(len(values[0]), len(values[1])),
                }
            )
    corrected = holm([row["p"] for row in rows])
    rows = [
        row | {"p (Holm)": p, "differ": "yes" if p < SIGNIFICANT else "no"}
        for row, p in zip(rows, corrected, strict=True)
    ]
    return sorted(rows, key=lambda row: row["p"])


def _values_of(paintings: Sequence[Painting], name: str) -> Array:
    """List the finite values of a measure in several paintings."""
    values = [painting.figures[name]["value"] for painting in paintings]
    return np.array([value for value in values if value is not None and np.isfinite(value)], float)


def permutation_p(first: Array, second: Array, random: np.random.Generator) -> float:
    """Test whether two samples have different means, and return the p-value of a permutation test.

    The p-value is the fraction of permutations whose means differ at least as much as observed. If there are more than
    `DRAWS` permutations, `DRAWS` random permutations and the observed one are used (Phipson and Smyth, 2010).
    """
    from scipy.stats import permutation_test  # noqa: PLC0415  (slow to import)

    def gap(one: Array, other: Array, axis: int) -> Array:
        return np.abs(one.mean(axis) - other.mean(axis))

    samples = first, second
    test = permutation_test(samples, gap, alternative="greater", n_resamples=DRAWS, vectorized=True, rng=random)
    return float(test.pvalue)


def least_p(first: int, second: int) -> float:
    """Compute the smallest p-value that `permutation_p` can return for samples of ``first`` and ``second`` values.

    Exchanging two samples of equal size gives the same absolute difference, which doubles the smallest p-value.
    """
    count = comb(first + second, first)
    return 1 / (DRAWS + 1) if count > DRAWS else (1 + (first == second)) / count


def write_paintings(folder: Path, frame: "DataFrame") -> None:
    """Write ``paintings.csv``, ``.md`` and ``.tex``, and ``groups.csv``, for two or more paintings."""
    paintings = paintings_of(frame)
    if len(paintings) < LEAST_PAINTINGS:
        return
    write_text(folder / "paintings.csv", csv_table(figure_rows(paintings)))
    rows, groups = painting_rows(paintings), group_rows(paintings)
    write_text(folder / "paintings.tex", latex_table(rows))
    text = [MEANING, markdown_table(rows)]
    if groups:
        write_text(folder / "groups.csv", csv_table(groups))
        text += ["## Groups", markdown_table([round_p(row) for row in groups])]
    write_text(folder / "paintings.md", "\n\n".join(text) + "\n")


def round_p(row: Mapping[str, Any]) -> dict[str, Any]:
    """Format the p-values of a row with two significant digits."""
    return {key: f"{value:.2g}" if isinstance(value, float) else value for key, value in row.items()}


def paintings_on_page(frame: "DataFrame") -> PageTable | None:
    """Tabulate the paintings of a sweep, or the differences between their groups; return None for other sweeps."""
    paintings = paintings_of(frame)
    if len(paintings) < LEAST_PAINTINGS:
        return None
    if groups := group_rows(paintings):
        return PageTable("groups", "Groups of paintings", MEANING, [round_p(row) for row in groups])
    return PageTable("paintings", "Paintings", MEANING, painting_rows(paintings))


COMPARISON = RunComparison(write_paintings, paintings_on_page)
