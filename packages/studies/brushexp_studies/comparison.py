"""Add comparisons to a sweep's report: verdicts, Pareto fronts, curves, effect plots and a contact sheet."""

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
    """Write all comparisons between a sweep's runs; for an album, write only a contact sheet."""
    if not is_album(frame):
        paired.write_differences(folder, frame)
        write_front_and_curves(folder, frame)
        write_effect(folder, frame)
    write_contact_sheet(folder, frame)


def write_front_and_curves(
    folder: Path, frame: DataFrame, cost: str | None = None, metrics: Sequence[str] = ()
) -> Path | None:
    """Write the Pareto front, the curves and the quality at equal time; return the path of the front's table."""
    write_anytime(folder, frame)
    write_curves(folder, frame)
    return write_front(folder, frame, cost, metrics)


def differences_on_page(frame: DataFrame) -> PageTable | None:
    """Tabulate the differences that have enough units for a verdict; return None if there are none."""
    every = paired.paired_differences(paired.paired_table(frame))
    differences = [one for one in every if len(one.gains) >= paired.LEAST_UNITS]
    if not differences:
        return None
    text = paired.explain_pairing(differences).replace("*", "").replace("`", "")
    return PageTable("paired", "Differences", text, paired.difference_rows(differences), numbers=("difference",))


COMPARISON = RunComparison(write_comparisons, differences_on_page)
