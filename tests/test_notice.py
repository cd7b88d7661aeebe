"""Tests that NOTICE states the origin of every packaged file that is not source code."""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

from program import ROOT

TEXT = (ROOT / "NOTICE").read_text()
NAMED = re.findall(r"^(brushexp\w*/\S+)$", TEXT, re.MULTILINE)
HATCH = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["wheel"]


def shipped() -> Iterator[tuple[str, Path]]:
    """Yield the files in the wheel, each as its path in the wheel and its path on disk."""
    for package in map(Path, HATCH["packages"]):
        for path in (ROOT / package).rglob("*"):
            if path.is_file() and "__pycache__" not in path.parts:
                yield str(path.relative_to(ROOT / package.parent)), path


def is_of_another_kind(path: Path) -> bool:
    """Return whether a file is something other than hand-written text: binary, minified, or a table of measurements."""
    return b"\0" in path.read_bytes() or ".min." in path.name or path.suffix == ".csv"


def test_every_file_that_is_no_source_code_is_named_once_and_nothing_else_is():
    assert sorted(NAMED) == sorted(name for name, path in shipped() if is_of_another_kind(path))
    assert "brushexp/pictures/faces/weights/yunet.safetensors" in NAMED


def test_licences_of_others_are_packed_beside_the_notice():
    packed = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["license-files"]
    licences = {path.name for _, path in shipped() if path.name.endswith("LICENSE.txt")}
    assert {Path(name).name for name in packed} == {"LICENSE", "NOTICE"} | licences
    assert set(re.findall(r"(\w+\.LICENSE\.txt)", TEXT)) == licences
