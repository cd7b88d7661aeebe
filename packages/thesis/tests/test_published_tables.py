"""The tables of the published pages are those of the records beside them, picture by picture."""

from pathlib import Path

import pandas as pd
import pytest
from brushexp_studies.paired import interval, paired_differences
from brushexp_thesis.claims import read_claims
from brushexp_thesis.judgements import judge
from brushexp_thesis.study_records import studies_in
from brushexp_thesis.verdicts import _table, _verdict_row, study_rows

from brushexp.contracts.results import escape_markdown

MOST_SECONDS = 7  # columns of the tables of equal seconds, whose rows begin alike
DOCS = Path(__file__).parents[3] / "docs"


@pytest.fixture(scope="module")
def studies():
    return studies_in([DOCS / "ablations"], DOCS)


@pytest.fixture(scope="module")
def page():
    return set((DOCS / "ablations.md").read_text(encoding="utf-8").splitlines())


def test_every_study_of_the_page_has_the_rows_of_its_record(studies, page):
    for study in studies.values():
        (table, _) = _table(study_rows(study, paired_differences(study.table)))
        assert set(table.splitlines()) <= page, study.name


def test_every_verdict_of_the_page_follows_from_the_records(studies, page):
    judged = judge((claim for listed in read_claims().values() for claim in listed), studies)
    (table, _) = _table([_verdict_row(one) for one in judged if one.difference is not None])
    assert set(table.splitlines()) <= page
    assert any(line.startswith(f"Verdicts on {len(judged)} claims: ") for line in page)


def test_means_and_intervals_of_the_leaderboard_are_those_of_its_pictures():
    """The record has two digits, so that a mean may differ in the last one."""
    records = pd.read_csv(DOCS / "records" / "leaderboard.csv", keep_default_na=False)
    lines = (DOCS / "leaderboard.md").read_text(encoding="utf-8").splitlines()
    groups = records.groupby(["painter", "settings", "strokes"], sort=False)
    assert len(groups) == 27
    for (painter, settings, strokes), pictures in groups:
        begins = f"| {escape_markdown(painter)} | {settings} | {strokes:,} | "
        told = [line.removeprefix(begins) for line in lines if line.startswith(begins)]
        said = next(cells for line in told if len(cells := line.split(" | ")) > MOST_SECONDS)[0]
        mean, _, high = interval(pictures["psnr"])
        told_mean, told_half = map(float, said.split(" ± "))
        assert (told_mean, told_half) == pytest.approx((mean, high - mean), abs=0.011), (painter, strokes)
