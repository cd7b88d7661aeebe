"""Add comparisons to a sweep's report: verdicts, fronts, curves, effects and a contact sheet."""

from collections.abc import Sequence
from pathlib import Path

from pandas import DataFrame

from brushexp.contracts.results import PageTable, RunComparison, is_album
from brushexp_studies import paired
from brushexp_studies.anytime import write_anytime, write_curves
from brushexp_studies.contact_sheet import write_contact_sheet
from brushexp_studies.effect import write_effect
from brushexp_studies.pareto import write_front


def write_comparisons(folder: Path, frame: DataFrame) -> None:
    """Write the comparisons of a sweep's runs; an album gets only a contact sheet."""
    if not is_album(frame):
        paired.write_differences(folder, frame)
        write_front_and_curves(folder, frame)
        write_effect(folder, frame)
    write_contact_sheet(folder, frame)


def write_front_and_curves(
    folder: Path, frame: DataFrame, cost: str | None = None, metrics: Sequence[str] = ()
) -> Path | None:
    """Write front, curves and quality at equal time of some runs; return the table of the front."""
    write_anytime(folder, frame)
    write_curves(folder, frame)
    return write_front(folder, frame, cost, metrics)


def differences_on_page(frame: DataFrame) -> PageTable | None:
    """Tabulate the differences that have enough units for a verdict; None if there are none."""
    every = paired.paired_differences(paired.paired_table(frame))
    differences = [one for one in every if len(one.gains) >= paired.LEAST_UNITS]
    if not differences:
        return None
    text = paired.explain_pairing(differences).replace("*", "").replace("`", "")
    return PageTable("paired", "Differences", text, paired.difference_rows(differences), numbers=("difference",))


COMPARISON = RunComparison(write_comparisons, differences_on_page)
