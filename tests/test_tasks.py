"""The program as users start it: what it writes, how it resumes, how it refuses."""

import json
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch
from PIL import Image
from program import ROOT, Program, run

from brushexp.strokes.prior import clamp_to_prior
from brushexp.strokes.storage import load_catalogue, save_catalogue

SMALL = ["image=chelsea", "resolution=48", "steps=30", "threads=1", "frames=5"]


def typed(*overrides: str, cwd: Path) -> subprocess.CompletedProcess:
    """The program as a user starts it, with all of its imports; the others are forks, and agree bit for bit."""
    command = [sys.executable, "-W", "ignore::FutureWarning", str(ROOT / "run.py"), *overrides]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, timeout=280, check=False)


def picture(path: Path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image)


@pytest.fixture(scope="module", autouse=True)
def _compiled(tmp_path_factory) -> None:
    """Have the kernels compiled and cached: the run that compiles them rounds differently in the last bit."""
    folder = tmp_path_factory.mktemp("compiled")
    run(*SMALL, "steps=2", "frames=0", f"output={folder}/run", cwd=folder)


@pytest.fixture(scope="module")
def painted(tmp_path_factory) -> Path:
    """Folder of a small finished run."""
    folder = tmp_path_factory.mktemp("painted") / "run"
    result = typed(*SMALL, f"output={folder}", cwd=folder.parent)
    assert result.returncode == 0, result.stderr
    assert "painting.png: " in result.stdout
    return folder


def test_a_run_leaves_all_its_results(painted):
    files = {path.name for path in painted.iterdir()}
    assert {"painting.png", "target.png", "catalogue.h5", "metrics.json", "run.log", ".hydra", "report.html"} <= files
    assert files & {"timelapse.mp4", "timelapse.gif"}
    assert "checkpoint.ckpt" not in files
    metrics = json.loads((painted / "metrics.json").read_text())
    assert metrics["status"] == "completed"
    assert metrics["steps"] == 30
    assert metrics["n_strokes"] == round(48 * 32 / 100)
    assert metrics["psnr"] > 12
    assert {
        "ssim",
        "l1",
        "perceptual",
        "seconds",
        "seconds_total",
        "seconds_per_step",
        "peak_memory_mb",
        "device",
    } <= set(metrics)


def test_psnr_is_that_of_the_saved_picture(painted):
    error = picture(painted / "painting.png").astype(float) - picture(painted / "target.png")
    psnr = 10 * np.log10(255**2 / (error**2).mean())
    assert json.loads((painted / "metrics.json").read_text())["psnr"] == pytest.approx(psnr, abs=1e-3)


def test_edges_are_compared_by_the_slopes_of_the_saved_pictures(painted):
    error = (picture(painted / "painting.png").astype(float) - picture(painted / "target.png")) / 255
    slopes = np.concatenate([np.diff(error, axis=axis).ravel() for axis in (0, 1)])
    found = json.loads((painted / "metrics.json").read_text())["edges"]
    assert found == pytest.approx(np.abs(slopes).mean(), rel=1e-4)


def test_a_saved_catalogue_renders_to_the_painting_and_larger(painted, tmp_path):
    result = run("task=export", f"catalogue={painted}/catalogue.h5", f"output={tmp_path}/same", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    same = picture(tmp_path / "same" / "painting.png").astype(int)
    assert np.abs(same - picture(painted / "painting.png")).max() <= 1
    result = run(
        "task=export", f"catalogue={painted}/catalogue.h5", "resolution=192", f"output={tmp_path}/large", cwd=tmp_path
    )
    assert result.returncode == 0, result.stderr
    large = picture(tmp_path / "large" / "painting.png")
    assert large.shape == (128, 192, 3)
    shrunk = np.asarray(Image.fromarray(large).resize((48, 32), Image.Resampling.BOX)).astype(float)
    assert np.abs(shrunk - picture(painted / "painting.png")).mean() < 12


def test_a_catalogue_tells_when_the_weights_are_others(painted, tmp_path):
    other = tmp_path / "catalogue.h5"
    save_catalogue(other, replace(load_catalogue(painted / "catalogue.h5"), renderer_hash="0123"))
    for path, warned in ((painted / "catalogue.h5", False), (other, True)):
        result = run("task=export", f"catalogue={path}", f"output={tmp_path}/a", cwd=tmp_path)
        assert result.returncode == 0, result.stderr
        assert ("painted with other weights of renderer=analytic" in result.stdout + result.stderr) is warned


def test_painting_goes_on_from_a_catalogue(painted, tmp_path):
    result = run(
        *SMALL, f"catalogue={painted}/catalogue.h5", "steps=0", "order=fixed", f"output={tmp_path}/a", cwd=tmp_path
    )
    assert result.returncode == 0, result.stderr
    assert np.abs(picture(tmp_path / "a" / "painting.png").astype(int) - picture(painted / "painting.png")).max() <= 1


def test_no_steps_paint_the_initialisation(tmp_path):
    result = run(*SMALL, "steps=0", f"output={tmp_path}/a", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert json.loads((tmp_path / "a" / "metrics.json").read_text())["steps"] == 0


def test_the_same_seed_gives_the_same_bits(painted, tmp_path):
    result = run(*SMALL, f"output={tmp_path}/a", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert np.array_equal(picture(tmp_path / "a" / "painting.png"), picture(painted / "painting.png"))


def test_an_interrupted_run_continues_exactly(tmp_path):
    settings = ["image=chelsea", "resolution=64", "steps=400", "threads=1", "frames=5", "order=accuracy"]
    process = Program(*settings, "checkpoint_every=0", f"output={tmp_path}/a", cwd=tmp_path)
    checkpoint = tmp_path / "a" / "checkpoint.ckpt"
    while not checkpoint.exists() and process.poll() is None:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=120)
    assert process.returncode == 130, err
    metrics = json.loads((tmp_path / "a" / "metrics.json").read_text())
    assert metrics["status"] == "interrupted"
    assert 0 < metrics["steps"] < 400
    assert (tmp_path / "a" / "painting.png").exists()
    assert checkpoint.exists()
    resumed = run(f"resume={tmp_path}/a", f"output={tmp_path}/b", cwd=tmp_path)
    assert resumed.returncode == 0, resumed.stderr
    whole = run(*settings, f"output={tmp_path}/c", cwd=tmp_path)
    assert whole.returncode == 0, whole.stderr
    with h5py.File(tmp_path / "b" / "catalogue.h5") as b, h5py.File(tmp_path / "c" / "catalogue.h5") as c:
        for name in c:
            assert np.array_equal(b[name], c[name]), name
    assert json.loads((tmp_path / "b" / "metrics.json").read_text())["steps"] == 400
    refused = run(f"resume={tmp_path}/a", "steps=9", cwd=tmp_path)
    assert refused.returncode == 1
    assert "drop steps=9" in refused.stdout + refused.stderr


@pytest.fixture(scope="module")
def windowed(tmp_path_factory) -> dict[str, str]:
    """Environment in which renderer=windowed, a patch renderer, can be chosen."""
    folder = tmp_path_factory.mktemp("plugins")
    code = ["from scenes import Windowed", "from brushexp.registry import register"]
    code += ['register("renderer", "windowed")(Windowed)']
    (folder / "windowed.py").write_text("\n".join(code))
    return {"BRUSHEXP_PLUGINS": str(folder), "PYTHONPATH": str(ROOT / "tests")}


def test_a_slow_renderer_takes_over_from_a_fast_one(windowed, tmp_path):
    settings = [*SMALL, "renderer=windowed", "finish_steps=8", "early_stop=null"]
    result = run(*settings, f"output={tmp_path}/a", cwd=tmp_path, **windowed)
    assert result.returncode == 0, result.stderr
    log = (tmp_path / "a" / "run.log").read_text()
    assert "step 30: switching to renderer windowed" in log
    assert "of 15 strokes were converted" in log
    metrics = json.loads((tmp_path / "a" / "metrics.json").read_text())
    assert metrics["steps"] == 38
    assert metrics["psnr"] > 12
    saved = load_catalogue(tmp_path / "a" / "catalogue.h5")
    assert saved.renderer == "windowed"
    valid = clamp_to_prior(saved.strokes)
    for name, value in saved.strokes.items():
        torch.testing.assert_close(getattr(valid, name), value, atol=1e-6, rtol=0)
    again = run("task=export", f"catalogue={tmp_path}/a/catalogue.h5", f"output={tmp_path}/b", cwd=tmp_path, **windowed)
    assert again.returncode == 0, again.stderr
    same = picture(tmp_path / "b" / "painting.png").astype(int)
    assert np.abs(same - picture(tmp_path / "a" / "painting.png")).max() <= 1


def test_an_interrupted_warm_up_continues_exactly(windowed, tmp_path):
    settings = ["image=chelsea", "resolution=48", "steps=400", "finish_steps=4", "threads=1", "frames=0"]
    settings += ["renderer=windowed", "warm_up=analytic"]
    process = Program(*settings, "checkpoint_every=0", f"output={tmp_path}/a", cwd=tmp_path, **windowed)
    while not (tmp_path / "a" / "checkpoint.ckpt").exists() and process.poll() is None:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=120)
    assert process.returncode == 130, err
    assert load_catalogue(tmp_path / "a" / "catalogue.h5").renderer == "windowed"
    resumed = run(f"resume={tmp_path}/a", f"output={tmp_path}/b", cwd=tmp_path, **windowed)
    assert resumed.returncode == 0, resumed.stderr
    whole = run(*settings, f"output={tmp_path}/c", cwd=tmp_path, **windowed)
    assert whole.returncode == 0, whole.stderr
    results = [load_catalogue(tmp_path / name / "catalogue.h5").strokes for name in ("b", "c")]
    for name, value in results[0].items():
        assert torch.equal(value, getattr(results[1], name)), name


def test_a_run_stops_when_nothing_is_gained(tmp_path):
    result = run(*SMALL, "steps=100000", "early_stop=20", f"output={tmp_path}/a", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    metrics = json.loads((tmp_path / "a" / "metrics.json").read_text())
    assert metrics["status"] == "stopped early"
    assert metrics["steps"] == 200


def test_a_sweep_ends_in_one_table_and_one_sheet(tmp_path):
    result = run(
        "-m",
        *SMALL,
        "steps=5",
        "frames=0",
        "loss=mse,perceptual",
        "init=grid,slic,scatter",
        "strokes=15,100000",
        f"output={tmp_path}/s",
        cwd=tmp_path,
    )
    assert result.returncode != 0, "half of the jobs ask for more strokes than pixels"
    rows = (tmp_path / "s" / "table.csv").read_text().splitlines()
    assert len(rows) == 1 + 12
    assert sum("failed" in row for row in rows) == 6
    assert "strokes=100000 is more than" in rows[2]
    assert (tmp_path / "s" / "table.md").exists()
    assert picture(tmp_path / "s" / "sheet.png").shape[1] > 400


def test_a_sweep_runs_on_several_cores(tmp_path):
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher")
    result = typed(
        "-m",
        *SMALL,
        "steps=5",
        "frames=0",
        "threads=null",
        "hydra/launcher=joblib",
        "hydra.launcher.n_jobs=2",
        "init=grid,scatter",
        f"output={tmp_path}/s",
        cwd=tmp_path,
    )
    assert result.returncode == 0, result.stderr
    assert len((tmp_path / "s" / "table.csv").read_text().splitlines()) == 3


def test_help_lists_every_plugin_in_one_line(tmp_path):
    result = typed("--help", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    for name in ("slic", "analytic", "tiled", "topk", "accuracy", "perceptual", "adam", "lbfgs", "scatter", "edges"):
        assert any(line.strip().startswith(f"{name} ") for line in result.stdout.splitlines()), name


REFUSED = {  # by each part of the program in turn; tests/test_mistakes.py has the others
    "nothing.png": "image=nothing.png",
    "image=chelsea stepz=3": "nearest first: steps",
    "image=chelsea steps=-1": "try steps=0",
    "image=nothing.png": "image=nothing.png",
    "image=chelsea strokes=999999": "picture has pixels",
    "image=chelsea device=cuda:7": "CUDA devices; use device=cpu",
    "image=chelsea catalogue=nothing.h5": "nothing.h5",
    "image=chelsea background=pinkish": "background=pinkish",
    "resume=nowhere": "give the folder of an interrupted run",
    "-m image=chelsea steps=5,abc": "steps=abc is not a whole number",
    "-m image=chelsea steps=5,-3": "job 1 of the sweep",
}


@pytest.mark.parametrize("overrides", REFUSED)
def test_bad_input_ends_in_one_clear_line(overrides, tmp_path):
    # With a request that cannot be met nothing may be left but the log and the settings.
    result = run(*overrides.split(), f"output={tmp_path}/a", cwd=tmp_path)
    assert result.returncode == 1
    lines = [line for line in (result.stdout + result.stderr).splitlines() if line.strip()]
    assert len(lines) == 1, lines
    assert REFUSED[overrides] in lines[0]
    left = {path.name for path in (tmp_path / "a").glob("*")} if (tmp_path / "a").exists() else set()
    assert left <= {".hydra", "run.log"}


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("in the way")
    result = run(*SMALL, f"output={tmp_path}/file/run", cwd=tmp_path)
    assert result.returncode == 1
    assert "choose another place with output=" in result.stderr
    assert len(result.stderr.splitlines()) == 1


def test_a_broken_plugin_ends_in_one_clear_line(tmp_path):
    (tmp_path / "plugins").mkdir()
    (tmp_path / "plugins" / "mine.py").write_text("class Half(\n")
    result = run(*SMALL, cwd=tmp_path, BRUSHEXP_PLUGINS=str(tmp_path / "plugins"))
    assert result.returncode == 1
    assert len(result.stderr.splitlines()) == 1
    assert "mine.py, line 1" in result.stderr


@pytest.mark.parametrize("size", [(1, 1), (3000, 4)])
def test_strange_pictures_work(tmp_path, size):
    Image.new("RGB", size, (200, 30, 90)).save(tmp_path / "strange.png")
    result = run("image=strange.png", "steps=3", "threads=1", f"output={tmp_path}/a", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert picture(tmp_path / "a" / "painting.png").shape == (size[1], size[0], 3)
    assert json.loads((tmp_path / "a" / "metrics.json").read_text())["ssim"] is None
