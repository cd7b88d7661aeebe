"""The citation is of this program, in this version."""

import yaml
from program import ROOT

import brushexp


def test_the_citation_has_the_version_and_what_its_format_needs():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation.keys() >= {"cff-version", "message", "title", "authors"}
    assert (citation["title"], citation["version"]) == ("brushexp", brushexp.__version__)
    assert "Copyright (c) 2026 " + citation["authors"][0]["name"] in (ROOT / "LICENSE").read_text()
