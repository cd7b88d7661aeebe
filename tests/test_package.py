"""The package as users install it: a wheel in an environment of its own, used in a folder that knows no checkout."""

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest
from program import ROOT
from skimage import data, io

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


def test_a_wheel_paints_in_a_folder_with_a_photograph_and_things_of_the_users(command, tmp_path):
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


def test_a_wheel_holds_all_that_is_no_code(command):
    (wheel,) = command.parents[2].glob("*.whl")
    packed = {name for name in zipfile.ZipFile(wheel).namelist() if name.startswith("brushexp/")}
    known = subprocess.run(["git", "ls-files", "src/brushexp"], cwd=ROOT, capture_output=True, text=True, check=True)
    assert {name.removeprefix("src/") for name in known.stdout.split()} <= packed
