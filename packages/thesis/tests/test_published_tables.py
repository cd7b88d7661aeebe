"""Test that the tables on the published pages agree with the records stored beside them."""

from pathlib import Path

import pandas as pd
import pytest
from brushexp_studies.paired import interval, paired_differences
from brushexp_thesis.claims import read_claims
from brushexp_thesis.judgements import judge
from brushexp_thesis.study_records import studies_in
from brushexp_thesis.verdicts import (
    SHIPPED_PAINTINGS,
    _table,
    numbers_of_settings,
    verdict_numbers,
    verdict_row,
)

from brushexp.contracts.files import yaml_of
from brushexp.contracts.results import csv_table, escape_markdown

DOCS = Path(__file__).parents[3] / "docs"


@pytest.fixture(scope="module")
def studies():
    return studies_in([DOCS / "ablations"], DOCS)


@pytest.fixture(scope="module")
def page():
    return set((DOCS / "ablations.md").read_text(encoding="utf-8").splitlines())


@pytest.fixture(scope="module")
def judged(studies):
    return judge((claim for listed in read_claims().values() for claim in listed), studies)


def test_every_study_of_the_page_has_the_numbers_of_its_record(studies, page):
    settings = []
    for study in studies.values():
        assert f"## {study.name}" in page
        settings += csv_table(numbers_of_settings(study, paired_differences(study.table))).splitlines()
    assert set(settings) == set((DOCS / "ablations" / "settings.csv").read_text(encoding="utf-8").splitlines())


def test_every_verdict_of_the_page_follows_from_the_records(judged, page):
    measured = [one for one in judged if one.difference is not None]
    (table, _) = _table([verdict_row(one) for one in measured])
    assert set(table.splitlines()) <= page
    assert any(line.startswith(f"Verdicts on {len(judged)} claims: ") for line in page)
    numbers = pd.read_csv(DOCS / "ablations" / "verdicts.csv", dtype=str, keep_default_na=False)
    assert numbers["claim"].tolist() == [one.claim.says for one in measured]
    paintings = set(yaml_of(SHIPPED_PAINTINGS.read_text(encoding="utf-8"), list))
    for place in range(0, len(measured), 8):  # each median needs a bootstrap
        row = verdict_numbers(measured[place], paintings)
        assert numbers.loc[place, list(row)].to_dict() == row


def test_means_and_intervals_of_the_leaderboard_are_those_of_its_pictures():
    """The leaderboard's means and intervals agree with its records to within rounding.

    The records have two decimal places, so the last digit of a mean may differ.
    """
    records = pd.read_csv(DOCS / "records" / "leaderboard.csv", keep_default_na=False)
    lines = (DOCS / "leaderboard.md").read_text(encoding="utf-8").splitlines()
    groups = records.groupby(["painter", "settings", "strokes"], sort=False)
    assert len(groups) == 27
    for (painter, settings, strokes), pictures in groups:
        begins = f"| {escape_markdown(painter)} | {settings} | {strokes:,} | "
        (said,) = [line.removeprefix(begins).split(" | ")[0] for line in lines if line.startswith(begins)]
        mean, _, high = interval(pictures["psnr"])
        told_mean, told_half = map(float, said.split(" ± "))
        assert (told_mean, told_half) == pytest.approx((mean, high - mean), abs=0.011), (painter, strokes)
