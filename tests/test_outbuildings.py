"""Packages use what a stranger may use, and the program does without any of them."""

import ast
import os
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = {path.name: path for path in ROOT.glob("packages/*")}
MODULES = {path.name for path in ROOT.glob("packages/*/brushexp_*")}
SHARED = {"brushexp_studies", "brushexp_training"}  # other packages may import these
# The program as it is where none of the packages is installed, once with each words.
ALONE = """
import importlib.metadata, sys

class Absent:
    def find_spec(name, path=None, target=None):
        if name.partition(".")[0] in {modules}:
            raise ModuleNotFoundError(name)

def entry_points(installed=importlib.metadata.entry_points, **which):
    return () if which.get("group", "").startswith("brushexp.") else installed(**which)

sys.meta_path.insert(0, Absent)
importlib.metadata.entry_points = entry_points
from brushexp.__main__ import main
for sys.argv[1:] in {words}:
    try:
        main()
    except SystemExit as end:
        assert not end.code
"""


def imports_in(folder: Path) -> Iterator[tuple[Path, str]]:
    """Files of a folder, and each name that they import, with its module."""
    for path in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom):
                yield from ((path, f"{node.module}.{alias.name}") for alias in node.names)
            elif isinstance(node, ast.Import):
                yield from ((path, alias.name) for alias in node.names)


def top_of(name: str) -> str:
    return name.partition(".")[0]


def test_the_core_imports_no_package():
    assert not {f"{path}: {name}" for path, name in imports_in(ROOT / "src") if top_of(name) in MODULES}


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_imports_only_what_a_stranger_may(package):
    for folder in (path for path in PACKAGES[package].iterdir() if path.name != "tests"):
        for path, name in imports_in(folder):
            place = f"{path}: {name}"
            assert top_of(name) not in MODULES - SHARED - {folder.name}, place
            if top_of(name) == "brushexp":
                assert not name.startswith("brushexp.cli"), place
                assert not any(part.startswith("_") for part in name.split(".")), place


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_has_tests_and_is_in_the_wheel(package):
    assert list(PACKAGES[package].glob("tests/test_*.py"))
    wheel = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["wheel"]
    for folder in (path for path in PACKAGES[package].iterdir() if path.name != "tests"):
        assert str(folder.relative_to(ROOT)) in wheel["packages"]


@pytest.mark.slow
def test_the_program_helps_and_paints_without_them(tmp_path):
    small = ["image=coffee", "look=even", "resolution=32", "strokes=12", "steps=2", "frames=0", "output=out"]
    code = ALONE.format(modules=MODULES, words=[["look=even", "--help"], small])
    environment = os.environ | {"BRUSHEXP_PLUGINS": ""}
    found = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300,
        check=False,
    )  # fmt: skip
    assert found.returncode == 0, found.stderr
    assert "Its keys and their values now" in found.stdout
    assert (tmp_path / "out" / "painting.png").is_file()
    assert (tmp_path / "out" / "report.html").is_file()
