"""The program as users start it: what it writes, how it resumes, how it refuses."""

import json
import os
import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
import torch
from films import pixels_of
from PIL import Image
from program import ROOT, run

from brushexp.config.vocabulary import SHIPPED
from brushexp.strokes.prior import clamp_to_prior
from brushexp.strokes.storage import load_catalogue
from brushexp.tasks import export, paint

pytestmark = pytest.mark.slow
SMALL = ["look=plain", "image=chelsea", "resolution=48", "steps=30", "threads=1", "frames=5"]


def typed(*overrides: str, cwd: Path, code: int = 0, **environment: str) -> subprocess.CompletedProcess:
    """Start the program as a user does, with all of its imports; the other tests fork it."""
    command = [sys.executable, "-W", "ignore::FutureWarning", "-m", "brushexp", *overrides]
    env = {**os.environ, "BRUSHEXP_PLUGINS": str(ROOT / "plugins"), **environment}
    done = subprocess.run(command, check=False, env=env, capture_output=True, text=True, cwd=cwd, timeout=280)
    assert done.returncode == code, done.stderr
    return done


def metrics_of(folder: Path) -> dict:
    return json.loads((folder / "metrics.json").read_text())


@pytest.fixture(scope="module")
def painted(tmp_path_factory) -> Path:
    """Folder of a small finished run."""
    folder = tmp_path_factory.mktemp("painted") / "run"
    done = typed(*SMALL, f"output={folder}", cwd=folder.parent)
    log = (folder / "run.log").read_text()
    last = [line for line in done.stdout.splitlines() if "%" not in line and not line.startswith("compiling ")]
    assert [line.split("  ")[0] for line in last[:3]] == ["writing the page", "run/painting.png", "run/report.html"]
    assert last[2].endswith("look at it: brushexp view run")
    assert re.match(r"next: .*: brushexp ", last[3])
    assert not any(word in line for line in last for word in ("dB", "SSIM", "INFO"))
    assert re.search(r"\]\[INFO\] - .*painting.png: .* dB.*, SSIM", log), "run.log has the figures"
    return folder


def test_a_run_leaves_all_its_results_and_the_metrics_are_those_of_the_saved_pictures(painted):
    files = {path.name for path in painted.iterdir()}
    assert {"painting.png", "target.png", "catalogue.h5", "metrics.json", "run.log", ".hydra", "report.html"} <= files
    assert files & {"timelapse.mp4", "timelapse.gif"}
    assert "checkpoint.ckpt" not in files
    metrics = metrics_of(painted)
    assert (metrics["status"], metrics["steps"], metrics["n_strokes"]) == ("completed", 30, round(48 * 32 / 100))
    named = {"ssim", "l1", "perceptual", "seconds", "seconds_total", "seconds_per_step", "peak_memory_mb", "device"}
    assert named <= metrics.keys()
    error = pixels_of(painted / "painting.png") - pixels_of(painted / "target.png")
    psnr = 10 * np.log10(255**2 / (error**2).mean())
    slopes = np.concatenate([np.diff(error / 255, axis=axis).ravel() for axis in (0, 1)])
    metrics = metrics_of(painted)
    assert 12 < metrics["psnr"] == pytest.approx(psnr, abs=1e-3)
    assert metrics["edges"] == pytest.approx(np.abs(slopes).mean(), rel=1e-4)


def test_a_saved_catalogue_renders_to_the_painting_larger_too_and_painting_goes_on_from_it(
    painted, run_task, tmp_path, caplog
):
    words = ["task=export", f"catalogue={painted}/catalogue.h5"]
    run_task(export, *words)
    assert "painted with other weights" not in caplog.text
    assert np.abs(pixels_of(tmp_path / "painting.png") - pixels_of(painted / "painting.png")).max() <= 1
    run_task(export, *words, "resolution=192")
    with Image.open(tmp_path / "painting.png") as large:
        assert large.size == (192, 128)
        shrunk = np.asarray(large.resize((48, 32), Image.Resampling.BOX)).astype(float)
    assert np.abs(shrunk - pixels_of(painted / "painting.png")).mean() < 12
    metrics = run_task(paint, *SMALL, f"catalogue={painted}/catalogue.h5", "steps=0", "order=fixed")
    assert np.abs(pixels_of(tmp_path / "painting.png") - pixels_of(painted / "painting.png")).max() <= 1
    assert metrics["steps"] == 0


@pytest.fixture(scope="module")
def windowed(tmp_path_factory) -> dict[str, str]:
    """Environment in which renderer=windowed, a patch renderer, can be chosen."""
    folder = tmp_path_factory.mktemp("plugins")
    code = ["from scenes import Windowed", "from brushexp.registry import register"]
    code += ['register("renderer", "windowed")(Windowed)']
    (folder / "windowed.py").write_text("\n".join(code))
    return {"BRUSHEXP_PLUGINS": str(folder), "PYTHONPATH": str(ROOT / "tests")}


def test_a_slow_renderer_takes_over_from_a_fast_one(windowed, tmp_path):
    words = [*SMALL, "renderer=windowed", "finish_steps=8", "early_stop=null", "output=a"]
    done = run(*words, cwd=tmp_path, **windowed)
    assert done.returncode == 0, done.stderr
    assert "step 30: switching to renderer windowed" in done.stdout
    assert "of 15 strokes were converted" in done.stdout
    metrics = metrics_of(tmp_path / "a")
    assert (metrics["steps"], metrics["psnr"] > 12) == (38, True)
    saved = load_catalogue(tmp_path / "a" / "catalogue.h5")
    assert saved.renderer == "windowed"
    valid = clamp_to_prior(saved.strokes)
    for name, value in saved.strokes.items():
        torch.testing.assert_close(getattr(valid, name), value, atol=1e-6, rtol=0)
    done = run("task=export", "catalogue=a/catalogue.h5", "output=b", cwd=tmp_path, **windowed)
    assert done.returncode == 0, done.stderr
    same = pixels_of(tmp_path / "b" / "painting.png")
    assert np.abs(same - pixels_of(tmp_path / "a" / "painting.png")).max() <= 1


SHY = """
from brushexp.errors import UserError
from brushexp.plugins.init.random import Random
from brushexp.registry import register

@register("init", "shy")
class Shy(Random):
    "At random, if there are few."

    def __call__(self, target, n, generator, focus=None):
        if n > 15:
            raise UserError("too many for me")
        return super().__call__(target, n, generator, focus)
"""


COUNTED = """
from brushexp.plugins.init.grid import Grid
from brushexp.registry import register

@register("init", "counted")
class Counted(Grid):
    "On a grid; a line in a file for each that is built."

    def __init__(self):
        super().__init__()
        with open("built.txt", "a") as file:
            print("built", file=file)
"""


@pytest.mark.parametrize(("words", "most"), [(["seed=0"], 1), (["-m", "seed=0,1"], 1 + 2)])
def test_a_run_builds_a_plugin_once_and_a_sweep_once_more_for_its_check(tmp_path, words, most):
    (tmp_path / "plugins").mkdir()
    (tmp_path / "plugins" / "counted.py").write_text(COUNTED)
    result = run(*words, *SMALL, "init=counted", "steps=1", "frames=0", "report=false", "output=a", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert len((tmp_path / "built.txt").read_text().splitlines()) == most


def test_a_sweep_on_several_cores_ends_in_one_table_and_one_sheet(tmp_path):
    """By workers that are no forks; sweeps of forks are painted in test_many_pictures."""
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher")
    (tmp_path / "plugins").mkdir()
    (tmp_path / "plugins" / "shy.py").write_text(SHY)
    swept = ["steps=5", "frames=0", "report=false", "init=shy", "strokes=15,20"]
    parallel = ["threads=null", "hydra/launcher=joblib", "hydra.launcher.n_jobs=2"]
    words = ["-m", *SMALL, *swept, *parallel, f"output={tmp_path}/s"]
    typed(*words, cwd=tmp_path, code=1, BRUSHEXP_PLUGINS=str(tmp_path / "plugins"))
    rows = (tmp_path / "s" / "table.csv").read_text().splitlines()
    assert ["failed" in row for row in rows[1:]] == [False, True]
    assert "too many for me" in rows[2]
    assert (tmp_path / "s" / "table.md").exists()
    assert pixels_of(tmp_path / "s" / "sheet.png").shape[1] > 400


def test_help_lists_every_plugin_in_one_line_and_a_mistake_ends_a_run_in_one_without_a_result(tmp_path):
    lines = [line.strip() for line in run("--help", cwd=tmp_path).stdout.splitlines()]
    for name in ("slic", "analytic", "tiled", "topk", "accuracy", "perceptual", "adam", "lbfgs", "scatter", "edges"):
        assert any(line.startswith(f"{name} ") for line in lines), name
    assert any(line.startswith("Samples, in place of a picture: astronaut, ") for line in lines)
    export = run("export", "--help", cwd=tmp_path).stdout
    assert export.startswith("brushexp export outputs/x [key=value ...]\n\ntask=export: Write a saved painting")
    assert run("--version", cwd=tmp_path).stdout == f"brushexp {version('brushexp')}\n"
    for path in (SHIPPED / "quality").glob("*.yaml"):
        measured = path.read_text().splitlines()[1].removeprefix("# ")
        assert any(line.startswith(f"{path.stem} ") and line.endswith(measured) for line in lines), path.stem
    result = run("nothing.png", f"output={tmp_path}/a", cwd=tmp_path)
    assert result.returncode == 1
    (line,) = [line for line in (result.stdout + result.stderr).splitlines() if line.strip()]
    assert "image=nothing.png" in line
    assert {path.name for path in (tmp_path / "a").glob("*")} <= {".hydra", "run.log"}


@pytest.mark.parametrize("size", [(1, 1), (3000, 4)])
def test_strange_pictures_work(run_task, tmp_path, size):
    Image.new("RGB", size, (200, 30, 90)).save(tmp_path / "strange.png")
    run_task(paint, f"image={tmp_path}/strange.png", "steps=3", "threads=1")
    assert pixels_of(tmp_path / "painting.png").shape == (size[1], size[0], 3)
    assert metrics_of(tmp_path)["ssim"] is None
