"""Tests of how runs end and resume: signals, non-finite steps, changed files and foreign folders."""

import errno
import json
import os
import pickle
import re
import shutil
import signal
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
from brushexp_policies.patches import Patches
from brushexp_training.stroke_sets.dataset import Origin
from brushexp_training.stroke_sets.writer import simulate_set
from catalogues import catalogue
from filelock import FileLock
from omegaconf import OmegaConf
from painters import fit, painter_of
from PIL import Image
from program import ended, run
from refusals import refuses
from scenes import random_strokes

from brushexp.bounds import INTERRUPTED_RUN
from brushexp.config.check import check
from brushexp.errors import UserError
from brushexp.painting.finished import finish
from brushexp.plugins.blend.base import Blend, Canvas
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.loss.base import Loss
from brushexp.plugins.loss.mse import MeanSquaredError
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.base import Renderer
from brushexp.plugins.sampler.whole import Whole
from brushexp.registry import build_named
from brushexp.results.runs import has_finished
from brushexp.runs import resume
from brushexp.runs.closing import how_to_go_on
from brushexp.runs.resume import RECORD_KEY, interrupted_run
from brushexp.runs.run_folder import take_folder
from brushexp.strokes.catalogue import FIELDS
from brushexp.strokes.storage import Saved, load_catalogue, save_catalogue
from brushexp.system.files import TEMPORARY, write_json
from brushexp.system.run_files import CHECKPOINT, MANIFEST, METRICS_FILE, note_files, recorded
from brushexp.system.runtime import free_memory
from brushexp.system.status import Status
from brushexp.tasks import paint


@pytest.fixture
def resumed(config, tmp_path, monkeypatch):
    """Return a function that resumes a run; if ``begun`` has words, it first writes a checkpoint of a run with them."""
    hydra = OmegaConf.create({"overrides": {"task": []}, "runtime": {"output_dir": str(tmp_path)}})
    monkeypatch.setattr(resume, "HydraConfig", SimpleNamespace(get=lambda: hydra))

    def go_on(*typed, task="paint", begun=()):
        if begun:
            torch.save({RECORD_KEY: resume.record_of(config(f"task={task}", *begun), tmp_path)}, tmp_path / CHECKPOINT)
        hydra.overrides.task = [*typed]
        return interrupted_run(tmp_path, config(f"task={task}"))[0]

    return go_on


def test_a_run_or_a_training_goes_on_with_the_settings_files_and_sets_that_it_began_with_alone(resumed, tmp_path):
    photo = tmp_path / "photo (1).png"
    Image.new("RGB", (40, 30), "navy").save(photo)
    restored = resumed(begun=[f"image='{photo}'", "steps=900"])
    assert (restored.image, restored.steps) == (str(photo), 900)
    refuses("drop steps=9", resumed, "steps=9")
    photo.write_bytes(photo.read_bytes()[:-1])
    refuses("has changed since the run began", resumed)
    place = tmp_path / "set"

    def simulate(n: int, seed: int = 0) -> None:
        simulate_set(place, build_named("engine", "disc", {"window": 64}), Origin("disc", {"window": 64}, 64), seed, n)

    simulate(40)
    assert resumed(task="train", begun=[f"data={place}"]).data == [str(place)]
    for n, seed in ((60, 0), (40, 1)):
        if seed:
            shutil.rmtree(place)
        simulate(n, seed)
        now = f"set has {n} strokes of seed {seed} now, but the run began with 40 strokes of seed 0; restore"
        refuses(now, resumed, task="train")


def test_a_run_that_goes_on_under_other_versions_says_so(resumed, tmp_path, caplog):
    resumed(begun=["steps=900"])
    assert "different environment" not in caplog.text
    checkpoint = torch.load(tmp_path / CHECKPOINT)
    checkpoint[RECORD_KEY]["provenance"] |= {"torch": "1.0", "plugins": {}}
    torch.save(checkpoint, tmp_path / CHECKPOINT)
    resumed()
    now = torch.__version__
    assert f"continues in a different environment (PyTorch (1.0, {now})); for a comparable" in caplog.text
    for other in (None, "odd"):  # of an earlier version, or damaged
        checkpoint[RECORD_KEY]["provenance"] = other
        torch.save(checkpoint, tmp_path / CHECKPOINT)
        caplog.clear()
        resumed()
        assert not caplog.text


@pytest.mark.parametrize(("holds", "message"), [
    ("notes.txt", "there is no checkpoint.ckpt; give the folder of an interrupted run"),
    ("metrics.json", "this run is finished, and nothing is left to continue"),
    ("multirun.yaml", "this is a sweep; repeat its command and add resume=sweep"),
])  # fmt: skip
def test_a_folder_that_cannot_go_on_says_what_it_is(tmp_path, holds, message):
    (tmp_path / holds).touch()
    refuses(re.escape(f"resume={tmp_path}: {message}"), INTERRUPTED_RUN.check, "resume", str(tmp_path))


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"text",
        b"\x80\x04.",
        pickle.dumps({RECORD_KEY: 1}),
        {"state_dict": {}},
        [1],
        {RECORD_KEY: {"settings": {}}},
        None,
    ],
    ids=["empty", "text", "binary", "pickle", "foreign", "list", "no-task", "cut"],
)
def test_what_is_no_checkpoint_is_refused(content, resumed, tmp_path):
    path = tmp_path / CHECKPOINT
    if content is None:
        resumed(begun=["steps=9"])
        path.write_bytes(path.read_bytes()[:-100])
    elif isinstance(content, bytes):
        path.write_bytes(content)
    else:
        torch.save(content, path)
    refuses(r"checkpoint\.ckpt is (damaged|not a checkpoint) .*; start (anew|a new run)", resumed)


@pytest.mark.parametrize(("version", "words"), [
    (resume.VERSION + 1, "has format_version 2, and this brushexp reads 1; update brushexp"),
    (0, "has an invalid format_version 0; get it again"),
    (True, "has an invalid format_version True; get it again"),
])  # fmt: skip
def test_a_checkpoint_of_a_later_program_is_refused_and_one_from_before_versions_goes_on(
    resumed, tmp_path, version, words
):
    resumed(begun=["steps=9"])
    path = tmp_path / CHECKPOINT
    record = torch.load(path)[RECORD_KEY]
    torch.save({RECORD_KEY: record | {"format_version": version}}, path)
    refuses(f"resume=.*{words}", resumed)
    torch.save({RECORD_KEY: {key: value for key, value in record.items() if key != "format_version"}}, path)
    assert resumed().steps == 9


class Breaking(Loss):
    """A mean squared error whose value or gradient is not finite from the third step on."""

    def __init__(self, how: str) -> None:
        super().__init__()
        self.how, self.steps_done, self.whole = how, int, MeanSquaredError()

    def forward(self, painting):
        value = self.whole(painting)
        if self.steps_done() < 2:  # steps
            return value
        if self.how == "gradient":
            return value + 0 * (painting.image - painting.image.detach()).abs().sum().sqrt()  # 0 times infinity
        return value * float(self.how)


@pytest.mark.parametrize("sampler", [Whole, partial(Patches, n_active=9, n_ring=3, patch=20)], ids=["whole", "parts"])
@pytest.mark.parametrize("how", ["nan", "inf", "gradient"])
def test_strokes_stay_as_they_were_before_a_step_that_gives_no_numbers(how, sampler):
    before = painter_of(losses={"broken": MeanSquaredError()}, steps=9, sampler=sampler())
    fit(before, max_steps=2)
    breaking = Breaking(how)
    broken = painter_of(losses={"broken": breaking}, steps=9, sampler=sampler())
    breaking.steps_done = lambda: broken.schedule.step
    trainer = fit(broken)
    assert (broken.stop, trainer.global_step) == (Status.DIVERGED, 3)
    trouble = "the gradient of loss=broken is not finite" if how == "gradient" else f"loss=broken is {how}"
    assert broken.trouble == f"step 3: {trouble}"
    for name, value in broken.strokes().items():
        torch.testing.assert_close(value, getattr(before.strokes(), name), atol=1e-6, rtol=1e-6)


class Spoilt(Renderer):
    """A renderer of analytic strokes that sets the colours of all strokes from index 2 onwards to NaN."""

    def forward(self, strokes):
        layers = Analytic()(strokes)
        return replace(layers, color=torch.where(torch.arange(len(strokes))[:, None] >= 2, torch.nan, layers.color))


class Spilling(Blend):
    """A blend that returns a picture with non-finite values or a non-finite gradient."""

    def __init__(self, how: str) -> None:
        self.how = how

    def __call__(self, *args):
        image = Tiled()(*args).image
        slope = 0 * (image - image.detach()).abs().sum().sqrt()  # 0 times infinity
        return Canvas(image + (torch.nan if self.how == "nan" else slope))


@pytest.mark.parametrize(("parts", "trouble"), [
    ({"renderer": Spoilt()}, "renderer=Spoilt draws stroke 2 with numbers that are not finite"),
    ({"blend": Spilling("nan")}, "blend=Spilling makes a picture that is not finite"),
    ({"blend": Spilling("gradient")}, "the gradient of blend=Spilling is not finite"),
])  # fmt: skip
def test_the_part_that_made_the_first_number_that_is_not_finite_is_named(parts, trouble):
    painter = painter_of(steps=3, **parts)
    fit(painter)
    assert (painter.stop, painter.trouble) == (Status.DIVERGED, f"step 1: {trouble}")


def test_a_config_from_a_file_runs_and_looks_up_nothing(tmp_path):
    touch = {"_target_": "pathlib.Path.touch", "_args_": [str(tmp_path / "it")]}
    with pytest.raises(UserError, match="optimizer has an option _target_, which is not allowed below a plugin"):
        build_named("optimizer", "torch", {"name": "SGD", "options": {"momentum": touch}})
    assert not (tmp_path / "it").exists()
    with pytest.raises(UserError, match=r"holds an interpolation, \$\{\.\.\.\}; write the value"):
        build_named("optimizer", "torch", {"name": "${oc.env:HOME}"})


def test_every_field_is_watched():
    painter = painter_of(n=4)
    assert painter.catalogue.is_finite()
    for name in FIELDS:
        if painter.catalogue.units[name]:
            value = getattr(painter.catalogue, name)
            before = value.detach().clone()
            with torch.no_grad():
                value.view(-1)[-1] = torch.inf
                assert not painter.catalogue.is_finite(), name
                value.copy_(before)


TINY = ["image=chelsea", "resolution=32", "strokes=12", "steps=8", "threads=1", "frames=0", "report=false"]
TINY += ["checkpoint_every=0", "device=cpu"]
THIRD_STEP: dict[str, torch.Tensor] = {}  # strokes of a run that ends at this step, painted once
PLAIN = Saved(random_strokes(2, (30, 9)), torch.arange(2), (30, 9), torch.ones(3), "analytic", "", 0, "")


@pytest.mark.parametrize(("error", "message"), [
    (RuntimeError("a bug"), "a bug"),
    (SystemExit(0), r"ended the program \(exit code 0\)"),
    (MemoryError(), "there is not enough memory; choose a smaller resolution= or strokes="),
    (RuntimeError("[enforce fail] DefaultCPUAllocator: can't allocate memory"), "there is not enough memory"),
    (OSError(errno.ENOSPC, "No space left"), "cannot write into .*: No space left; choose another"),
    (None, "step 4: loss=mse is nan; .* lower the rate, or choose others"),
], ids=["bug", "exit", "memory", "torch", "disk", "nan"])  # fmt: skip
def test_what_ends_a_painting_leaves_it_as_it_was_before_that_step(error, message, run_task, tmp_path, monkeypatch):
    calls, whole = [], MeanSquaredError.forward

    def forward(self, painting):
        calls.append(0)
        if len(calls) <= 4:  # one of them compiles the kernels
            return whole(self, painting)
        if error is None:
            return whole(self, painting) * torch.nan
        raise error

    monkeypatch.setattr(MeanSquaredError, "forward", forward)
    with pytest.raises((RuntimeError, UserError), match=message):
        run_task(paint, *TINY)
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert metrics["status"] == ("failed" if error else "diverged")
    assert metrics["steps"] == 3 + (error is None)
    assert (tmp_path / CHECKPOINT).exists()
    monkeypatch.setattr(MeanSquaredError, "forward", whole)
    before = load_catalogue(tmp_path / "catalogue.h5").strokes
    if not THIRD_STEP:
        run_task(paint, *TINY, "trainer.max_steps=3")
        THIRD_STEP.update(load_catalogue(tmp_path / "catalogue.h5").strokes.items())
    torch.testing.assert_close(dict(before.items()), THIRD_STEP, atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("full", [CHECKPOINT, "painting.png", "metrics.json"])
def test_a_full_disk_costs_no_more_than_what_it_cannot_hold(full, run_task, tmp_path, monkeypatch, caplog):
    real = os.fsync

    def fsync(descriptor):
        name = os.readlink(f"/proc/self/fd/{descriptor}")
        if name.endswith(Path(full).suffix) and (full != "painting.png" or (tmp_path / CHECKPOINT).exists()):
            raise OSError(errno.ENOSPC, "No space left on device")
        real(descriptor)

    with monkeypatch.context() as patched:
        patched.setattr("brushexp.system.files.os.fsync", fsync)
        if full == CHECKPOINT:
            assert run_task(paint, *TINY)["status"] == "completed"
            assert "could not write a checkpoint at step 7: cannot write" in caplog.text
            return
        refuses(rf"cannot write .*{full}: No space left on device; .* with output=", run_task, paint, *TINY)
    assert (tmp_path / CHECKPOINT).exists()
    assert not (tmp_path / "metrics.json").exists()
    assert not list(tmp_path.glob(TEMPORARY))


@pytest.mark.parametrize(("words", "message"), [
    ("task=export catalogue=c.h5 to=relief resolution=30000", r"to=relief: 9000 x 30000 .* resolution="),
    ("task=export catalogue=c.h5 to=gcode to.gcode.width_mm=900", r"900 is too wide for"),
    ("task=export catalogue=other.h5", r"renderer\.width=-3"),
    ("task=export catalogue=c.h5 to=gcode to.gcode.change=T{x}", r"other than {tool} and {color}"),
    ("task=train engine=disc batch_size=200000", r"batch_size=200000 strokes of .* smaller batch_size="),
    ("task=simulate engine=disc engine.window=256", r"2048 strokes of 256 x 256 .* smaller engine.window="),
    ("blend=dense strokes=100000 resolution=512", r"blend=dense would hold 100000 strokes at 262144"),
    ("style=astronaut style.loss.scale=0.02 resolution=512", r"has 10 x 10 pixels .* needs 32 x 32"),
    ("resolution=1000", r" strokes on 1000 x 1000 .* at least 0.5 GB .* 0.4 GB .* smaller resolution="),
    ("renderer=neural strokes=9000", r"need at least 1.2 GB .* or fewer strokes="),
])  # fmt: skip
def test_what_has_no_room_is_refused_before_any_job_starts(words, message, config, monkeypatch, tmp_path):
    words = words.split()
    monkeypatch.chdir(tmp_path)
    save_catalogue(Path("c.h5"), PLAIN)
    save_catalogue(Path("other.h5"), replace(PLAIN, renderer="neural", config="renderer: {width: -3}"))
    assert 10 < free_memory() < 1e9
    monkeypatch.setattr("brushexp.system.runtime.free_memory", lambda: 400)
    refuses(message, check, config(*words), words)


def leave(folder, *names):
    """Create files in a folder and record them in its manifest, as a run does."""
    (folder / ".hydra").mkdir(exist_ok=True, parents=True)
    with recorded(folder):
        for name in names:
            (folder / name).parent.mkdir(exist_ok=True, parents=True)
            (folder / name).write_text("a run's")


def files_in(folder):
    files = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    return files - {".hydra/lock", ".hydra/files.txt"}


def test_a_run_replaces_no_other_and_removes_nothing_but_what_runs_leave(tmp_path, config):
    folder, mine = tmp_path / "a", {"notes.txt", "report.html", "pictures/holiday.jpg", ".hidden"}
    (folder / "pictures").mkdir(parents=True)
    for name in mine:
        (folder / name).write_text("mine")
    take_folder(folder, config())  # in a folder of the user: nothing is refused or deleted
    run_leaves = {".hydra/config.yaml", "run.log", "target.png", "x.foo", "pictures/epoch_001.png", CHECKPOINT}
    leave(folder, *run_leaves, "report.html", f"{TEMPORARY[:-1]}0123.png")
    held = r"output=.* already holds a run \(checkpoint.ckpt\); continue it with resume="
    refuses(held, take_folder, folder, config())
    assert files_in(folder) == mine | run_leaves, "but for what writing that was killed has left"
    take_folder(folder, config(f"resume={folder}"))
    with pytest.raises(UserError, match=r"a run in output=.* would replace focus=.*target.png; choose another folder"):
        take_folder(folder, config("overwrite=true", f"focus={folder}/target.png"))
    (folder / CHECKPOINT).rename(folder / "metrics.json")
    refuses(r"already holds a run \(metrics.json\); choose another folder, or replace", take_folder, folder, config())
    (folder / "metrics.json").unlink()
    take_folder(folder, config())  # over a run without results
    assert files_in(folder) == mine


def test_what_a_kill_leaves_half_written_goes_wherever_the_run_has_written_and_where_it_is_resumed_from(
    tmp_path, config
):
    half = f"{TEMPORARY[:-1]}0123"
    run, other = tmp_path / "run", tmp_path / "other"
    leave(run, CHECKPOINT, "frames/deep/000000.h5", f"frames/deep/{half}.h5", f"frames/{half}.h5", f"{half}.png")
    (run / MANIFEST).write_text("frames/deep/000000.h5\n")
    (run / f"{half}_folder" / "tiles").mkdir(parents=True)  # of a pyramid
    (run / "mine" / "deep").mkdir(parents=True)
    (run / "mine" / "deep" / f"{half}.png").write_text("where no run has written")
    take_folder(other, config(f"resume={run}", f"output={other}"))
    assert files_in(run) == {CHECKPOINT, "frames/deep/000000.h5", f"mine/deep/{half}.png"}
    assert not (run / f"{half}_folder").exists()
    leave(run, f"frames/deep/{half}.h5")
    (run / MANIFEST).write_text("frames/deep/000000.h5\n")
    take_folder(run, config(f"resume={run}"))
    assert files_in(run) == {CHECKPOINT, "frames/deep/000000.h5", f"mine/deep/{half}.png"}


def test_a_manifest_of_a_stranger_names_nothing_outside_of_its_folder(tmp_path, config):
    leave(tmp_path / "a", "run.log", "0/metrics.json")
    for name in ("mine.txt", "b/mine.txt"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("mine")
    (tmp_path / "a" / "link").symlink_to(tmp_path / "b")
    lines = ["../mine.txt", f"{tmp_path}/mine.txt", "link/mine.txt", "0/../../mine.txt", ".hydra/files.txt"]
    with (tmp_path / "a" / MANIFEST).open("a") as manifest:
        manifest.write("\n".join(lines))
    take_folder(tmp_path / "a", config("overwrite=true"))
    assert files_in(tmp_path) - {"a/.hydra/lock", "a/.hydra/files.txt"} == {"mine.txt", "b/mine.txt"}


EXPORTER = """
from brushexp.plugins.export.base import Exporter
from brushexp.registry import register


@register("to", "foo")
class Foo(Exporter):
    "Two files."

    def write(self, job, folder):
        (folder / "parts").mkdir(exist_ok=True)
        (folder / "parts" / "y.foo").write_text("foo")
        (folder / "x.foo").write_text("foo")
        return [folder / "x.foo"]
"""


def test_an_exporter_leaves_nothing_after_overwriting_and_one_that_is_stopped_says_what_it_has(tmp_path):
    save_catalogue(tmp_path / "c.h5", PLAIN)
    (tmp_path / "plugins").mkdir()
    (tmp_path / "plugins" / "foo.py").write_text(EXPORTER)
    for form, names in (("foo", {"parts/y.foo", "x.foo"}), ("json", {"strokes.json"})):
        words = ["task=export", "catalogue=c.h5", f"to={form}", "output=b", "overwrite=true"]
        done = run(*words, cwd=tmp_path, BRUSHEXP_PLUGINS=str(tmp_path / "plugins"))
        assert done.returncode == 0, done.stderr
        written = {name for name in files_in(tmp_path / "b") if not name.startswith(".hydra")}
        assert written == names | {"metrics.json", "run.log"}
    assert not (tmp_path / "b" / "parts").exists()
    save_catalogue(tmp_path / "some.h5", catalogue())
    words = ["task=export", "catalogue=some.h5", "to=[svg,json]", "output=x"]
    code, output = ended(tmp_path, *words, kill=("strokes.svg", 1, True), sent=signal.SIGTERM)
    assert code == 128 + signal.SIGTERM
    assert output == "note: interrupted; x has strokes.svg; to start over, repeat the command with: output=x\n"
    code, output = ended(tmp_path, *words)
    assert code == 0, output
    assert (tmp_path / "x" / "strokes.json").is_file()


def test_a_run_never_replaces_what_it_is_made_from(tmp_path, config, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    (folder := tmp_path / "a").mkdir()
    for name in ("target.png", "style.png", "photo.jpg", "neural.safetensors"):
        (folder / name).write_text("mine")
    before = {path.name for path in folder.iterdir()}

    def refuse(*words, pictures=()):
        cfg = config(*words)
        OmegaConf.set_struct(cfg, False)
        cfg.hydra = {"sweeper": {"pictures": [*pictures]}}
        refuses(r"a run in output=.*a would replace .*; choose another folder", take_folder, folder, cfg)
        assert before <= {path.name for path in folder.iterdir()}

    refuse(f"image={folder}/target.png")
    refuse("style=~/a/style.png")
    refuse("overwrite=true", pictures=[f"{folder}/*.png"])
    refuse("task=train", f"renderer.checkpoint={folder}/neural.safetensors")
    take_folder(folder, config(f"image={folder}/photo.jpg", "style=~nobody.there/style.png"))
    leave(folder, "painting.png")
    before.add("painting.png")
    refuse("image=~/a/painting.png", "overwrite=true")
    refuse("overwrite=true", pictures=["~/a/painting.png"])


def test_what_is_read_below_a_folder_of_a_run_stays_and_a_link_goes_alone(tmp_path, config):
    folder, disk = tmp_path / "a", tmp_path / "disk"
    leave(disk, "catalogue.h5")
    leave(folder, "catalogue.h5", "added/theirs.png")
    (folder / "catalogue.h5").unlink()
    (folder / "catalogue.h5").symlink_to(disk / "catalogue.h5")
    with pytest.raises(UserError, match=r"would replace runs.0=.*added; choose another folder"):
        take_folder(folder, config("task=leaderboard", f"runs={folder}/added", "overwrite=true"))
    with pytest.raises(UserError, match=r"would replace catalogue=.*catalogue.h5; choose another folder"):
        take_folder(folder, config(f"catalogue={folder}/catalogue.h5", "overwrite=true"))
    take_folder(folder, config("overwrite=true"))
    assert not (folder / "added").exists()
    assert not (folder / "catalogue.h5").is_symlink()
    assert (disk / "catalogue.h5").exists()


def test_jobs_are_replaced_with_their_sweep_and_other_runs_in_its_folder_stay(tmp_path, config):
    leave(tmp_path, "multirun.yaml")
    for name in ("1_2", "3"):
        leave(tmp_path / name, CHECKPOINT, "painting.png")
    with recorded(tmp_path):
        note_files(tmp_path, [tmp_path / "1_2" / name for name in ("painting.png", MANIFEST)])  # the first is in both
    held = r"already holds a run \(1_2/checkpoint.ckpt\); repeat the command with resume=sweep"
    refuses(held, take_folder, tmp_path, config())
    take_folder(tmp_path, config("overwrite=true"))
    assert files_in(tmp_path) == {f"3/{name}" for name in (CHECKPOINT, "painting.png", MANIFEST)}


def test_a_painting_without_its_film_and_page_has_not_finished(tmp_path):
    for status, is_over in (("completed", True), ("stopped early", True), ("at work", False), ("interrupted", False)):
        write_json(tmp_path / "metrics.json", {"status": status, "psnr": 20.0})
        assert has_finished(tmp_path) == is_over


def test_one_run_at_a_time_is_in_a_folder(tmp_path):
    (tmp_path / "a" / ".hydra").mkdir(parents=True)
    with FileLock(tmp_path / "a" / ".hydra" / "lock"):
        code, output = ended(tmp_path, *TINY, "output=a")
    assert code == 1
    assert output == "brushexp: another run is at work in output=a; wait for it, or choose another folder\n"
    assert [path.name for path in (tmp_path / "a").iterdir()] == [".hydra"], "nothing is written"
    code, output = ended(tmp_path, *TINY, "output=/proc/x")
    assert code == 1
    assert output.startswith("brushexp: cannot write into output=/proc/x")


def test_ctrl_c_after_the_last_step_leaves_the_painting(run_task, tmp_path, monkeypatch, caplog):
    def press(*arguments, **options):
        signal.raise_signal(signal.SIGINT)
        return finish(*arguments, **options)

    monkeypatch.setattr("brushexp.system.runtime._received", [])
    monkeypatch.setattr(paint, "finish", press)
    with pytest.raises(KeyboardInterrupt):
        run_task(paint, *TINY)
    assert {"painting.png", "catalogue.h5"} <= {path.name for path in tmp_path.iterdir()}
    assert "stopping once painting and catalogue are written (press Ctrl-C again to stop at once)" in caplog.text
    assert not has_finished(tmp_path)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize(("files", "task", "said"), [
    ([], "export", "nothing is finished; to start over, repeat the command with: output=my run"),
    (["run.log", "a", "b"], "export", "my run has a, b; to start over, repeat the command with: output=my run"),
    (["a", "b", "c", "d", "e", "painting.png"], "x", "my run has painting.png, a, b, c and 2 more; to start over"),
    ([METRICS_FILE], "paint", f"my run has {METRICS_FILE}; to start over, repeat the command with: output=my run over"),
    (["a", CHECKPOINT], "paint", "continue with: brushexp resume=my run"),
    ([CHECKPOINT], "train", "continue with: brushexp task=train resume=my run"),
])  # fmt: skip
def test_what_is_finished_is_named_and_what_to_type(files, task, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (folder := tmp_path / "my run" / ".hydra").mkdir(parents=True)
    with recorded(folder.parent):
        for name in files:
            (folder.parent / name).touch()
    assert how_to_go_on(folder.parent, task).replace("'", "").startswith(said)
