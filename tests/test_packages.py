"""Tests that the core runs alone, and that packages are complete and use only the core's public interface."""

import ast
import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import venv
import zipfile
from collections.abc import Iterable, Iterator
from importlib.metadata import distribution
from pathlib import Path

import pytest
from program import ROOT
from skimage import data, io

from brushexp import __version__
from brushexp.registry import Plugin, plugins
from brushexp.system.words import conf_folders

PACKAGES = {path.name: path for path in ROOT.glob("packages/*")}
MODULES = {path.name for path in ROOT.glob("packages/*/brushexp_*")}
SHARED = {"brushexp_studies", "brushexp_training", "brushexp_testing"}  # other packages may import these
# The program as if no package were installed, with several command lines in turn.
ALONE = """
import json
import sys
from types import SimpleNamespace

from brushexp.system import published

class Absent:
    def find_spec(name, path=None, target=None):
        if name.startswith({modules}):
            raise ModuleNotFoundError(name)

sys.meta_path.insert(0, Absent)
published._all_entry_points = lambda: SimpleNamespace(select=lambda group: ())

import brushexp
from brushexp.__main__ import main

for sys.argv[1:] in {commands}:
    print("==", *sys.argv[1:], flush=True)
    try:
        main()
    except SystemExit as end:
        assert not end.code, sys.argv
states = list(brushexp.iterate("coffee", look="plain", resolution=24, strokes=6, steps=2, every=1))
assert [state.step for state in states] == [0, 1, 2]
"""
SMALL = ["resolution=32", "steps=2", "frames=0", "report=false"]


def imports_in(folder: Path) -> Iterator[tuple[Path, str]]:
    """Yield every import in a folder's Python files, as the file and the full name of the import."""
    for path in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom):
                yield from ((path, f"{node.module}.{alias.name}") for alias in node.names)
            elif isinstance(node, ast.Import):
                yield from ((path, alias.name) for alias in node.names)


def top_of(name: str) -> str:
    return name.partition(".")[0]


@pytest.mark.slow
def test_without_any_package_the_core_paints_its_looks_and_qualities_sweeps_and_helps(tmp_path):
    looks = sorted(path.stem for path in (ROOT / "src/brushexp/conf/look").glob("*.yaml"))
    qualities = sorted(path.stem for path in (ROOT / "src/brushexp/conf/quality").glob("*.yaml"))
    assert {"oil", "plain", "even"} <= set(looks)
    commands = [["coffee", f"look={look}", "quality=draft", *SMALL, f"output={look}"] for look in looks]
    commands += [["coffee", "look=oil", f"quality={one}", "detail=0.02", *SMALL, f"output={one}"] for one in qualities]
    commands += [["-m", "loss=mse,perceptual", "init=grid,slic", "look=even", *SMALL, "output=sweep"]]
    commands += [["coffee", f"loss=[{','.join(textbook_losses())}]", "order=fixed", *SMALL, "output=losses"]]
    commands += [["--help"], ["--help=all"], ["--help=tasks"], ["--help=research"], ["renderer=", "--help"]]
    absent = ("brushexp_", *(f"hydra_plugins.{path.stem}" for path in ROOT.glob("packages/*/hydra_plugins/*.py")))
    code = ALONE.format(modules=absent, commands=commands)
    environment = os.environ | {"BRUSHEXP_PLUGINS": ""}
    found = subprocess.run(
        [sys.executable, "-W", "ignore:.*Error importing 'hydra_plugins", "-c", code],
        cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert found.returncode == 0, found.stderr
    for name in (*looks, *qualities, "losses", *(f"sweep/{number}" for number in range(4))):
        assert (tmp_path / name / "painting.png").is_file(), found.stderr
    offered = found.stdout.partition("== --help\n")[2]
    assert "Most useful keys" in offered
    assert not names_in(offered, settings_of_packages())


def textbook_losses() -> list[str]:
    """List the core losses that need no style picture and no other painting."""
    return sorted(plugin.name for plugin in plugins("loss") if is_core(plugin) and plugin.name not in STYLES)


STYLES = ("style", "brushwork")


def is_core(plugin: Plugin) -> bool:
    return plugin.module.startswith("brushexp.")


def settings_of_packages() -> set[str]:
    """Return the settings that only packages provide, such as ``loss=sinkhorn``, and the packages' module names."""
    shipped, *others = conf_folders()
    names = {f"{plugin.family}={plugin.name}" for plugin in plugins() if not is_core(plugin)}
    names |= {f"{path.parent.name}={path.stem}" for folder in others for path in folder.glob("*/*.yaml")}
    names |= {f"task={point.name}" for point in distribution("brushexp").entry_points.select(group="brushexp.tasks")}
    return (names | MODULES) - {f"{path.parent.name}={path.stem}" for path in shipped.glob("*/*.yaml")}


def names_in(text: str, names: Iterable[str]) -> list[str]:
    return [name for name in names if re.search(rf"(?<![\w.]){re.escape(name)}(?!\w)", text)]


def test_no_text_of_the_core_names_a_package_or_what_only_a_package_has():
    names = settings_of_packages()
    assert {"look=watercolour", "brushexp_media", "task=recover", "loss=sinkhorn", "experiment=order"} <= names
    texts = {path: path.read_text() for path in (ROOT / "src/brushexp/conf").rglob("*.*") if path.suffix[1:] in TEXTS}
    found = [f"{path}: {name}" for path, text in texts.items() for name in names_in(text, names)]
    alone = {*PACKAGES, *(name.partition("=")[2] for name in names if name.startswith("task="))} - WORDS
    for path in (ROOT / "src").rglob("*.py"):
        tree = ast.parse(path.read_text())
        docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docstrings:
                wrong = [*names_in(node.value, names), *({node.value} & alone)]
                found += [f"{path}:{node.lineno}: {name}" for name in wrong]
    assert not found, "\n".join(found)


TEXTS = ("yaml", "toml")
WORDS = {
    "brushes",
    "canvas",
    "changes",
    "exports",
    "measure",
    "media",
    "films",
    "losses",
    "gpu",
}  # words that also name parts of the core


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_uses_only_the_face_of_the_core_and_is_whole(package):
    folder = PACKAGES[package]
    for path, name in (pair for part in folder.iterdir() if part.name != "tests" for pair in imports_in(part)):
        place = f"{path}: {name}"
        assert top_of(name) not in MODULES - SHARED - {path.relative_to(folder).parts[0]}, place
        if top_of(name) == "brushexp":
            assert name == "brushexp" or name.startswith(("brushexp.contracts", "brushexp.testing")), place
    assert list(folder.glob("tests/test_*.py"))
    about = (folder / "README.md").read_text().splitlines()
    assert len(about) <= 12
    assert any(line.startswith("    ") for line in about), "one command"
    wheel = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["wheel"]
    for part in (path for path in folder.iterdir() if path.is_dir() and path.name not in ("tests", "__pycache__")):
        assert str(part.relative_to(ROOT)) in wheel["packages"]
        for inner in (path for path in part.rglob("*") if path.is_dir()):
            assert len([*inner.glob("*.py")]) <= MOST_MODULES, f"{inner} needs folders"


MOST_MODULES = 16  # in a folder, including ``__init__``


pytestmark = pytest.mark.slow
LARGEST_WHEEL = 12e6  # bytes, mostly weights
LOOK = "# @package _global_\n# a look of one's own\nsteps: 4\nresolution: 40\nframes: 0\nrenderer:\n  taper: 0.5\n"


@pytest.fixture(scope="module")
def command(tmp_path_factory) -> Path:
    """Install a wheel of this checkout beside the tests' libraries, and return the path of its ``brushexp`` command."""
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
    assert wheel.name.startswith(f"brushexp-{__version__}-")
    assert wheel.stat().st_size < LARGEST_WHEEL
    assert not [name for name in zipfile.ZipFile(wheel).namelist() if {"tests", "docs"} & set(name.split("/"))]
    assert f"brushexp-{__version__}.dist-info/licenses/NOTICE" in zipfile.ZipFile(wheel).namelist()
    packed = {name for name in zipfile.ZipFile(wheel).namelist() if name.startswith("brushexp/")}
    known = subprocess.run(["git", "ls-files", "src/brushexp"], cwd=ROOT, capture_output=True, text=True, check=True)
    assert {name.removeprefix("src/") for name in known.stdout.split()} <= packed
