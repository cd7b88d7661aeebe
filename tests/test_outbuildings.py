"""Packages use what a stranger may use, and the program does without any of them."""

import ast
import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import venv
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from program import ROOT
from skimage import data, io

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


@pytest.mark.slow
def test_the_core_imports_no_package_and_the_program_helps_and_paints_without_them(tmp_path):
    assert not {f"{path}: {name}" for path, name in imports_in(ROOT / "src") if top_of(name) in MODULES}
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


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_imports_only_what_a_stranger_may_has_tests_and_is_in_the_wheel(package):
    for folder in (path for path in PACKAGES[package].iterdir() if path.name != "tests"):
        for path, name in imports_in(folder):
            place = f"{path}: {name}"
            assert top_of(name) not in MODULES - SHARED - {folder.name}, place
            if top_of(name) == "brushexp":
                assert not name.startswith("brushexp.cli"), place
                assert not any(part.startswith("_") for part in name.split(".")), place
    assert list(PACKAGES[package].glob("tests/test_*.py"))
    wheel = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["wheel"]
    for folder in (path for path in PACKAGES[package].iterdir() if path.name != "tests"):
        assert str(folder.relative_to(ROOT)) in wheel["packages"]


pytestmark = pytest.mark.slow
LOOK = "# @package _global_\n# a look of one's own\nsteps: 4\nresolution: 40\nframes: 0\nrenderer:\n  taper: 0.5\n"


@pytest.fixture(scope="module")
def command(tmp_path_factory) -> Path:
    """The command ``brushexp`` of a wheel made of this checkout; the libraries it needs are those of the tests."""
    folder = tmp_path_factory.mktemp("package")
    left_out = shutil.ignore_patterns(".*", "build", "outputs", "data", "__pycache__", "*.egg-info", "docs", "tests")
    shutil.copytree(ROOT, folder / "source", ignore=left_out)
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", "--no-input"]
    options = ["--no-deps", "--no-build-isolation", "--no-index", "--wheel-dir", str(folder)]
    subprocess.run([*pip, "wheel", *options, str(folder / "source")], check=True)
    venv.create(folder / "venv", with_pip=False)
    (wheel,) = folder.glob("*.whl")
    subprocess.run(
        [*pip, "--python", str(folder / "venv"), "install", "--no-deps", "--no-index", str(wheel)], check=True
    )
    (site,) = (folder / "venv").glob("lib/python*/site-packages")
    (site / "libraries.pth").write_text(sysconfig.get_path("purelib"))
    for source in (ROOT / "src").glob("brushexp/**/*.py"):
        installed = site / source.relative_to(ROOT / "src")
        for kernel in (source.parent / "__pycache__").glob(f"{source.stem}.*.nb?"):  # compiled for a source of this age
            shutil.copy(kernel, installed.parent / "__pycache__")
            shutil.copystat(source, installed)
    return folder / "venv" / "bin" / "brushexp"


def test_a_wheel_paints_in_a_folder_with_things_of_the_users_and_holds_all_that_is_no_code(command, tmp_path):
    (tmp_path / "conf" / "look").mkdir(parents=True)
    (tmp_path / "conf" / "look" / "mine.yaml").write_text(LOOK)
    (tmp_path / "plugins").mkdir()
    shutil.copy(ROOT / "plugins" / "edges.py", tmp_path / "plugins" / "mine.py")
    io.imsave(tmp_path / "photo.jpg", data.chelsea()[::4, ::4])
    words = ["photo.jpg", "look=mine", "loss=[edges]", "effort=0.5", "renderer=textured", "output=painted"]
    alone = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "BRUSHEXP_PLUGINS")}
    done = subprocess.run([command, *words], cwd=tmp_path, env=alone, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "Warning" not in done.stderr
    metrics = json.loads((tmp_path / "painted" / "metrics.json").read_text())
    assert metrics["steps"] == 2, "quality scales the user's looks, too; what they say of another renderer is left out"
    assert {"painting.png", "report.html", "catalogue.h5"} <= {path.name for path in (tmp_path / "painted").iterdir()}
    assert "photo.jpg" in (tmp_path / "painted" / ".hydra" / "overrides.yaml").read_text()
    (wheel,) = command.parents[2].glob("*.whl")
    packed = {name for name in zipfile.ZipFile(wheel).namelist() if name.startswith("brushexp/")}
    known = subprocess.run(["git", "ls-files", "src/brushexp"], cwd=ROOT, capture_output=True, text=True, check=True)
    assert {name.removeprefix("src/") for name in known.stdout.split()} <= packed
