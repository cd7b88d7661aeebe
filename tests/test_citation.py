"""Tests of the citation files, and of the version, which is defined in one place."""

import re
import tomllib

import yaml
from program import ROOT, run

import brushexp


def test_the_citation_has_the_version_and_what_its_format_needs():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation.keys() >= {"cff-version", "message", "title", "authors"}
    assert (citation["title"], citation["version"]) == ("brushexp", brushexp.__version__)
    assert "Copyright (c) 2026 " + citation["authors"][0]["name"] in (ROOT / "LICENSE").read_text()
    assert f"version = {{{brushexp.__version__}}}" in (ROOT / "docs" / "index.md").read_text()


def test_the_version_stands_in_one_place_and_the_command_prints_it(tmp_path):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert project["project"]["dynamic"] == ["version"]
    place = ROOT / project["tool"]["hatch"]["version"]["path"]
    assert place.read_text().count(f'"{brushexp.__version__}"') == 1
    assert run("--version", cwd=tmp_path).stdout == f"brushexp {brushexp.__version__}\n"


def test_the_paper_cites_every_entry_of_its_bibliography_and_no_other():
    paper, bibliography = ((ROOT / name).read_text() for name in ("paper.md", "paper.bib"))
    head = yaml.safe_load(paper.split("---")[1])
    assert head.keys() >= {"title", "tags", "authors", "affiliations", "date", "bibliography"}
    assert {*re.findall(r"@([a-z]+\d{4})", paper)} == {*re.findall(r"^@\w+\{(\w+),", bibliography, re.MULTILINE)}
