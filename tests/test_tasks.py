"""Tests of the program as users start it, with one picture or a folder: output files, resuming and refusals."""

import json
import math
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from films import pixels_of
from PIL import Image
from program import ROOT, ended, run
from refusals import refuses

from brushexp import __version__
from brushexp.cli import many_pictures
from brushexp.cli.many_pictures import (
    all_pictures,
    expand_jobs,
    expand_pictures,
    launcher,
    pictures_named,
    subfolders_for,
)
from brushexp.cli.program import expand_arguments
from brushexp.config.rules import EFFORT
from brushexp.config.tasks import TASKS
from brushexp.config.words import parse_value, verbatim
from brushexp.pictures.load import samples
from brushexp.plugins.metric.base import STANDARD
from brushexp.results.runs import JOBS
from brushexp.runs.sweep_jobs import SUBFOLDER, override_value
from brushexp.strokes.prior import clamp_to_prior
from brushexp.strokes.storage import load_catalogue
from brushexp.system import device, runtime
from brushexp.system.reading import digest_of
from brushexp.system.words import SHIPPED, conf_folders
from brushexp.tasks import export, paint

pytestmark = pytest.mark.slow
SMALL = ["look=plain", "image=chelsea", "resolution=48", "steps=30", "threads=1", "frames=5"]


def typed(*overrides: str, cwd: Path, code: int = 0, **environment: str) -> subprocess.CompletedProcess:
    """Start the program in a new process, as a user does; the other tests fork a process that has imported it."""
    command = [sys.executable, "-W", "ignore::FutureWarning", "-m", "brushexp", *overrides]
    env = {**os.environ, "BRUSHEXP_PLUGINS": str(ROOT / "plugins"), **environment}
    done = subprocess.run(command, check=False, env=env, capture_output=True, text=True, cwd=cwd, timeout=280)
    assert done.returncode == code, done.stderr
    return done


def metrics_of(folder: Path) -> dict:
    return json.loads((folder / "metrics.json").read_text())


@pytest.fixture(scope="module")
def painted(tmp_path_factory) -> Path:
    """Paint a small run, and return its folder."""
    folder = tmp_path_factory.mktemp("painted") / "run"
    done = typed(*SMALL, f"output={folder}", cwd=folder.parent)
    log = (folder / "run.log").read_text()
    last = [line for line in done.stdout.splitlines() if "%" not in line and not line.startswith("compiling ")]
    assert [line.split("  ")[0] for line in last[:3]] == ["writing the page", "run/painting.png", "run/report.html"]
    assert last[2].endswith("to open it, type: brushexp view run")
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
    numbers = {name for name, value in metrics.items() if type(value) in (int, float)}
    assert numbers - {*STANDARD, "psnr_lit"} == set(EFFORT), "what may be the objective"
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
    """Return environment variables that make renderer=windowed, a patch renderer, available."""
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
    """A sweep whose workers are not forks ends in one table and one sheet; later tests cover forks."""
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher")
    (tmp_path / "plugins").mkdir()
    (tmp_path / "plugins" / "shy.py").write_text(SHY)
    (tmp_path / "plugins" / "zz.py").write_text("def unfinished(:\n")
    swept = ["steps=5", "frames=0", "report=false", "init=shy", "strokes=15,20"]
    parallel = ["threads=null", "hydra/launcher=joblib", "hydra.launcher.n_jobs=2"]
    words = ["-m", *SMALL, *swept, *parallel, f"output={tmp_path}/s"]
    done = typed(*words, cwd=tmp_path, code=1, BRUSHEXP_PLUGINS=str(tmp_path / "plugins"))
    assert done.stderr.count("zz.py") == 1, "a worker says nothing again"
    rows = (tmp_path / "s" / "table.csv").read_text().splitlines()
    assert ["failed" in row for row in rows[1:]] == [False, True]
    assert "too many for me" in rows[2]
    assert (tmp_path / "s" / "table.md").exists()
    assert pixels_of(tmp_path / "s" / "sheet.png").shape[1] > 400


def test_help_is_one_page_that_leads_to_everything_and_a_mistake_ends_a_run_in_one_line_without_a_result(tmp_path):
    first = run("--help", cwd=tmp_path).stdout
    lines = [line.strip() for line in first.splitlines()]
    assert len(lines) <= 100
    assert {"brushexp photo.jpg", "brushexp --help=all", "brushexp --help=tasks", "brushexp renderer --help"} <= {
        line.partition("   ")[0] for line in lines
    }
    every = [line.strip() for line in run("--help=all", cwd=tmp_path).stdout.splitlines()]
    for name in ("slic", "analytic", "tiled", "topk", "accuracy", "perceptual", "adam", "lbfgs", "scatter", "edges"):
        assert any(line.startswith(f"{name} ") for line in every), name
    assert any(line.startswith("Sample pictures: astronaut, ") for line in every)
    assert (
        "  options of renderer=neural, and their current values"
        in run("renderer=neural", "--help", cwd=tmp_path).stdout
    )
    topics = {topic: run(f"--help={topic}", cwd=tmp_path).stdout for topic in ("tasks", "research")}
    for name, task in TASKS.items():
        assert [f"\n  {name} " in text for text in topics.values()] == [not task.is_research, task.is_research], name
    export = run("export", "--help", cwd=tmp_path).stdout
    assert export.startswith("brushexp export outputs/x [key=value ...]\n\nExport a finished painting")
    unknown = run("--help=everything", cwd=tmp_path).stderr
    cure = "type --help, or --help= and a family such as look, or one of all, tasks, research"
    assert unknown == f"brushexp: --help=everything is not a topic; {cure}\n"
    assert run("look", "--help", cwd=tmp_path).stdout.startswith("look: medium or style of a painting\n  even ")
    assert run("--version", cwd=tmp_path).stdout == f"brushexp {__version__}\n"
    for path in (SHIPPED / "quality").glob("*.yaml"):
        measured = path.read_text().splitlines()[1].removeprefix("# ")
        assert f" {path.stem} {measured}" in " ".join(" ".join(lines).split()), path.stem
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


QUICK = ("look=plain", "steps=2", "frames=0", "report=false", "logger=[]")


def photos(folder: Path) -> Path:
    """Make a folder of three pictures, one of which is invalid, and a text file."""
    folder.mkdir()
    for k, name in enumerate(("a b,c.png", "second.jpg")):
        Image.new("RGB", (24 + k, 16), (90 * k, 40, 200)).save(folder / name)
    (folder / "broken.jpg").write_bytes(b"none")
    (folder / "notes.txt").write_text("no picture")
    return folder


def test_all_pictures_are_painted_and_the_same_command_goes_on(tmp_path):
    """The first command paints one picture at a time; the second goes on from there in two processes."""
    name = "my \\${photos}"
    photos(tmp_path / name)
    code, output = ended(tmp_path, f"image={name}", "jobs=1", *QUICK)
    folder = tmp_path / "outputs" / name.replace("${", "{")
    assert code == 1
    assert "broken.jpg is not a picture of a known format" in output
    assert "1 of 3 jobs failed: 1" in output
    status = {path.parent.name: json.loads(path.read_text())["status"] for path in folder.glob("*/metrics.json")}
    assert status == {"a_b_c": "completed", "second": "completed", "broken": "failed"}
    page = (folder / "report.html").read_text()
    assert "a_b_c" in page
    assert "is not a picture of a known format" in page
    assert (folder / "table.md").exists()
    assert (folder / "sheet.png").exists()
    before = (folder / "second" / "painting.png").stat().st_mtime_ns
    Image.new("RGB", (24, 16)).save(tmp_path / name / "broken.jpg")  # repaired, and a new picture added
    Image.new("RGB", (9, 16)).save(tmp_path / name / "new.png")
    code, output = ended(tmp_path, f"image={name}", "jobs=2", *QUICK)
    assert code == 0, output
    assert "2 of 4 jobs are already finished" in output
    assert (folder / "second" / "painting.png").stat().st_mtime_ns == before
    assert (folder / "new" / "painting.png").is_file()
    code, output = ended(tmp_path, f"image={name}", *QUICK, "strokes=3")
    assert code == 1
    assert "has paintings with other settings" in output


PLUGIN = """
import gc, os, signal
from pathlib import Path
from brushexp.plugins.init.grid import Grid
from brushexp.registry import register


@register("init", "own")
class Own(Grid):
    def __call__(self, *arguments):
        {}
        return super().__call__(*arguments)
"""
COUNT = """locks = sum(os.path.realpath(file).endswith("lock") for file in Path("/proc/self/fd").iterdir())
        with open("counts.txt", "a") as file:
            print(locks, gc.get_freeze_count(), file=file)"""
DEAF = """try:
            open("first", "x").close()
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            Path("deaf").touch()
        except FileExistsError:
            while not Path("deaf").exists():
                pass
            os.kill(os.getpid(), signal.SIGKILL)"""


@pytest.fixture
def own_init(tmp_path):
    """Return a function that writes a plugin, init=own, which runs the given code before it places strokes."""
    (tmp_path / "plugins").mkdir()
    return lambda code: (tmp_path / "plugins" / "own.py").write_text(PLUGIN.format(code))


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="another system")
def test_a_finished_job_leaves_no_open_file_and_nothing_that_is_never_freed(tmp_path, own_init):
    own_init(COUNT)
    code, output = ended(tmp_path, "-m", "image=chelsea", "resolution=16", "init=own", "seed=0,1,2", *QUICK)
    assert code == 0, output
    counts = [[*map(int, line.split())] for line in (tmp_path / "counts.txt").read_text().splitlines()]
    assert len(counts) == 3
    assert all(later <= first for after in counts[1:] for first, later in zip(counts[0], after, strict=True))


@pytest.mark.skipif(launcher() != "processes", reason="another launcher here")
def test_a_process_that_is_killed_or_hears_no_signal_ends_its_sweep_which_goes_on_later(tmp_path, own_init):
    own_init("os.kill(os.getpid(), signal.SIGKILL)")
    words = ("-m", "init=grid,own", "jobs=2", "output=s", "image=chelsea", "resolution=16", *QUICK)
    code, output = ended(tmp_path, *words)
    assert code == 1
    assert "job 1 has ended without a result" in output
    assert "resume=sweep" in output
    own_init("")
    code, output = ended(tmp_path, *words, "resume=sweep")
    assert code == 0, output
    assert {path.parent.name for path in (tmp_path / "s").glob("*/painting.png")} == {"0", "1"}
    own_init(DEAF)
    code, output = ended(tmp_path, "-m", "init=own", "seed=0,1", "jobs=2", "image=chelsea", "resolution=16", *QUICK)
    assert code == 1
    assert "has ended without a result" in output
    assert "Traceback" not in output


def test_the_words_of_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    photos(tmp_path / "p")
    flag, look, output, named, *more = expand_pictures(["image=p", "look=ink"], False)
    assert (flag, look, output) == ("--multirun", "look=ink", "output=outputs/p")
    assert (named, more) == ('hydra.sweeper.pictures=["p"]', ["hydra.sweeper.lenient=true"])
    _, output, named, _ = expand_pictures(["pictures=thesis12,p"], False)
    assert (output, named) == ("output=outputs/thesis12_p", 'hydra.sweeper.pictures=["thesis12","p"]')
    for typed in ("[thesis12,p]", "[thesis12, 'p']", '["thesis12",p]'):
        assert expand_pictures([f"pictures={typed}"], False) == expand_pictures(["pictures=thesis12,p"], False)
    pictures = [str(Path("p", name)) for name in ("second.jpg", "a b,c.png")]
    _, look, output, settings, _ = expand_pictures([f"image={pictures[0]}", "look=ink", f"image={pictures[1]}"], False)
    assert (look, output) == ("look=ink", "output=outputs/p")
    assert settings.index("second.jpg") < settings.index("a b,c.png")
    jobs = tmp_path / "outputs" / "p" / JOBS
    jobs.parent.mkdir(parents=True)
    jobs.touch()
    assert "hydra.sweeper.resume=true" in expand_pictures(["image=p"], False)
    for word in ("overwrite=true", "overwrite=True", "overwrite=1"):
        assert "hydra.sweeper.resume=true" not in expand_pictures(["image=p", word], False)
    jobs.unlink()
    assert expand_arguments([*pictures, "look=ink"]) == expand_pictures(
        [*(f"image={one}" for one in pictures), "look=ink"], False
    )
    assert expand_pictures(["image=astronaut"], False) == ["image=astronaut"]
    assert expand_pictures(["image=p/[a-z ,]*.png"], False)[1] == "output=outputs/p"
    for name in (r"a\b", "a'b", 'a"b'):  # any name reaches the program unchanged
        photos(tmp_path / name)
        (named,) = (
            word for word in expand_pictures([f"image={name}"], False) if word.startswith("hydra.sweeper.pictures=")
        )
        assert parse_value(named.partition("=")[2]) == [name]


def test_sets_folders_and_single_pictures_stand_for_pictures(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    photos(tmp_path / "p")
    own = tmp_path / "conf" / "pictures"
    own.mkdir(parents=True)
    (own / "mine.yaml").write_text("- camera  # a sample\n- red.png\n")
    folders = [*conf_folders(), tmp_path / "conf"]
    refuses(r"pictures=mine has no red.png; put such files beside .*mine.yaml", pictures_named, "mine", folders)
    Image.new("RGB", (9, 16)).save(own / "red.png")
    assert pictures_named("mine", folders) == ["camera", str(own / "red.png")]
    assert pictures_named("conf/pictures/mine.yaml", conf_folders()) == ["camera", "conf/pictures/red.png"]
    assert [Path(one).name for one in pictures_named("p", folders)] == ["a b,c.png", "broken.jpg", "second.jpg"]
    assert all_pictures(["mine", "camera", "coffee"], folders) == ["camera", str(own / "red.png"), "coffee"]
    (own / "sealed.yaml").write_text(f"- conf/pictures/red.png: {digest_of(own / 'red.png')}\n- camera\n")
    assert pictures_named("sealed", folders) == ["conf/pictures/red.png", "camera"]  # relative to the current folder
    Image.new("RGB", (9, 17)).save(own / "red.png")
    words = r"pictures=sealed: conf/pictures/red.png is not the file that .*SHA-256 is"
    refuses(words, pictures_named, "sealed", folders)
    (own / "empty.yaml").write_text("[]")
    for wrong, message in (("empty", "is empty; list pictures"), ("nope.yaml", "nope.yaml")):
        refuses(message, pictures_named, wrong, folders)
    refuses("there are no pictures", pictures_named, str(tmp_path), folders)
    shipped = pictures_named("thesis12", [SHIPPED])
    assert len(set(shipped)) == 12
    assert set(shipped) <= samples().keys(), "it needs no file of yours"


def test_names_of_folders_are_plain_and_differ_and_are_read_as_they_are():
    assert subfolders_for(["x/a.jpg", "x/a.png", "x/ü 1.tif"]) == ["a_jpg", "a_png", "ü_1"]
    assert subfolders_for(["x/a.jpg", "y/a.jpg"]) == ["a_jpg", "a_jpg_2"]
    assert len(set(subfolders_for(["a/x.png", "b/x.png", "c/x_png_2.png"]))) == 3
    for name in ("a", "1_0", "20240105_123456", "2024.10", "null", "été", "1e5", "true"):
        assert override_value(SUBFOLDER + verbatim(name)) == name


def test_jobs_are_processes(monkeypatch):
    assert expand_jobs(["jobs=2", "a=1"]) == ["a=1", f"hydra/launcher={launcher()}", "hydra.launcher.n_jobs=2"]
    assert expand_jobs(["jobs=1"]) == []
    refuses("jobs=x is not a number", expand_jobs, ["jobs=x"])
    monkeypatch.setattr(many_pictures, "find_spec", lambda _: True)
    monkeypatch.setattr(runtime, "cores", lambda: 5)
    monkeypatch.setattr(device, "device_of", lambda _: torch.device("cpu"))
    for memory, pictures, count in ((1e6, 40, 5), (7000, 40, 3), (500, 40, 1), (1e6, 4, 2), (1e6, 3, 1)):
        monkeypatch.setattr(runtime, "free_memory", lambda memory=memory: memory)
        expected = [f"hydra/launcher={launcher()}", f"hydra.launcher.n_jobs={count}"] if count > 1 else []
        assert expand_jobs(["jobs=auto"], pictures) == expand_jobs([], pictures) == expected
    monkeypatch.setattr(runtime, "free_memory", lambda: math.inf)
    assert expand_jobs(["jobs=auto"])[-1] == "hydra.launcher.n_jobs=5"
    monkeypatch.setattr(device, "device_of", lambda _: torch.device("cuda"))
    monkeypatch.setattr("brushexp.contracts.machine.device_of", device.device_of)
    assert expand_jobs(["jobs=2"]) == ["hydra/launcher=joblib", "hydra.launcher.n_jobs=2"], (
        "CUDA does not survive a fork"
    )
    typed = ["hydra/launcher=dask"]
    assert (expand_jobs([]), expand_jobs(typed, 40)) == ([], typed)
