"""A folder of pictures is a sweep: one process, one page, broken files skipped, and the same command goes on."""

import json
import math
from pathlib import Path

import pytest
import torch
from PIL import Image
from program import ended
from refusals import refuses

from brushexp.cli import many_pictures
from brushexp.cli.many_pictures import all_pictures, as_sweep, in_processes, launcher, pictures_named, subfolders_for
from brushexp.cli.program import expand_arguments
from brushexp.config.vocabulary import SHIPPED
from brushexp.config.words import parse_value, verbatim
from brushexp.errors import UserError
from brushexp.pictures.load import samples
from brushexp.results.runs import JOBS
from brushexp.runs.sweep_jobs import SUBFOLDER, override_value
from brushexp.system import device, runtime
from brushexp.system.reading import digest_of

pytestmark = pytest.mark.slow
QUICK = ("look=plain", "steps=2", "frames=0", "report=false", "logger=[]")


def photos(folder: Path) -> Path:
    """Three pictures, of which one is none, and a file of another kind."""
    folder.mkdir()
    for k, name in enumerate(("a b,c.png", "second.jpg")):
        Image.new("RGB", (24 + k, 16), (90 * k, 40, 200)).save(folder / name)
    (folder / "broken.jpg").write_bytes(b"none")
    (folder / "notes.txt").write_text("no picture")
    return folder


def test_all_pictures_are_painted_and_the_same_command_goes_on(tmp_path):
    """First one after another, then in two processes."""
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
    Image.new("RGB", (24, 16)).save(tmp_path / name / "broken.jpg")  # mended, and a new one beside it
    Image.new("RGB", (9, 16)).save(tmp_path / name / "new.png")
    code, output = ended(tmp_path, f"image={name}", "jobs=2", *QUICK)
    assert code == 0, output
    assert "2 of 4 jobs have finished already" in output
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


@pytest.fixture
def own_init(tmp_path):
    """Write a plugin, init=own, that does something before it places strokes."""
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
def test_a_process_that_is_killed_ends_its_sweep_which_goes_on_later(tmp_path, own_init):
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


DEAF = """try:
            open("first", "x").close()
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            Path("deaf").touch()
        except FileExistsError:
            while not Path("deaf").exists():
                pass
            os.kill(os.getpid(), signal.SIGKILL)"""


@pytest.mark.skipif(launcher() != "processes", reason="another launcher here")
def test_a_job_that_hears_no_signal_does_not_keep_a_sweep_from_its_end(tmp_path, own_init):
    own_init(DEAF)
    code, output = ended(tmp_path, "-m", "init=own", "seed=0,1", "jobs=2", "image=chelsea", "resolution=16", *QUICK)
    assert code == 1
    assert "has ended without a result" in output
    assert "Traceback" not in output


def test_the_words_of_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    photos(tmp_path / "p")
    flag, look, output, named, *more = as_sweep(["image=p", "look=ink"], False)
    assert (flag, look, output) == ("--multirun", "look=ink", "output=outputs/p")
    assert (named, more) == ('hydra.sweeper.pictures=["p"]', ["hydra.sweeper.lenient=true"])
    _, output, named, _ = as_sweep(["pictures=thesis12,p"], False)
    assert (output, named) == ("output=outputs/thesis12_p", 'hydra.sweeper.pictures=["thesis12","p"]')
    pictures = [str(Path("p", name)) for name in ("second.jpg", "a b,c.png")]
    _, look, output, settings, _ = as_sweep([f"image={pictures[0]}", "look=ink", f"image={pictures[1]}"], False)
    assert (look, output) == ("look=ink", "output=outputs/p")
    assert settings.index("second.jpg") < settings.index("a b,c.png")
    jobs = tmp_path / "outputs" / "p" / JOBS
    jobs.parent.mkdir(parents=True)
    jobs.touch()
    assert "hydra.sweeper.resume=true" in as_sweep(["image=p"], False)
    for word in ("overwrite=true", "overwrite=True", "overwrite=1"):
        assert "hydra.sweeper.resume=true" not in as_sweep(["image=p", word], False)
    jobs.unlink()
    assert expand_arguments([*pictures, "look=ink"]) == as_sweep(
        [*(f"image={one}" for one in pictures), "look=ink"], False
    )
    assert as_sweep(["image=astronaut"], False) == ["image=astronaut"]
    assert as_sweep(["image=p/[a-z ,]*.png"], False)[1] == "output=outputs/p"
    for name in (r"a\b", "a'b", 'a"b'):  # any name reaches the program as it is
        photos(tmp_path / name)
        (named,) = (word for word in as_sweep([f"image={name}"], False) if word.startswith("hydra.sweeper.pictures="))
        assert parse_value(named.partition("=")[2]) == [name]


def test_sets_folders_and_single_pictures_stand_for_pictures(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    photos(tmp_path / "p")
    own = tmp_path / "conf" / "pictures"
    own.mkdir(parents=True)
    (own / "mine.yaml").write_text("- camera  # a sample\n- red.png\n")
    folders = [SHIPPED, tmp_path / "conf"]
    refuses(r"pictures=mine has no red.png; put such files beside .*mine.yaml", pictures_named, "mine", folders)
    Image.new("RGB", (9, 16)).save(own / "red.png")
    assert pictures_named("mine", folders) == ["camera", str(own / "red.png")]
    assert pictures_named("conf/pictures/mine.yaml", [SHIPPED]) == ["camera", "conf/pictures/red.png"]
    assert [Path(one).name for one in pictures_named("p", folders)] == ["a b,c.png", "broken.jpg", "second.jpg"]
    assert all_pictures(["mine", "camera", "coffee"], folders) == ["camera", str(own / "red.png"), "coffee"]
    (own / "sealed.yaml").write_text(f"- conf/pictures/red.png: {digest_of(own / 'red.png')}\n- camera\n")
    assert pictures_named("sealed", folders) == ["conf/pictures/red.png", "camera"]  # from the current folder
    Image.new("RGB", (9, 17)).save(own / "red.png")
    with pytest.raises(UserError, match=r"pictures=sealed: conf/pictures/red.png is not the file that .*SHA-256 is"):
        pictures_named("sealed", folders)
    (own / "empty.yaml").write_text("[]")
    for wrong, message in (("empty", "is empty; list pictures"), ("nope.yaml", "nope.yaml")):
        refuses(message, pictures_named, wrong, folders)
    refuses("no picture is there", pictures_named, str(tmp_path), folders)
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
    assert in_processes(["jobs=2", "a=1"]) == ["a=1", f"hydra/launcher={launcher()}", "hydra.launcher.n_jobs=2"]
    assert in_processes(["jobs=1"]) == []
    refuses("jobs=x is no number", in_processes, ["jobs=x"])
    monkeypatch.setattr(many_pictures, "find_spec", lambda _: True)
    monkeypatch.setattr(runtime, "cores", lambda: 5)
    monkeypatch.setattr(device, "device_of", lambda _: torch.device("cpu"))
    for memory, pictures, count in ((1e6, 40, 5), (7000, 40, 3), (500, 40, 1), (1e6, 4, 2), (1e6, 3, 1)):
        monkeypatch.setattr(runtime, "free_memory", lambda memory=memory: memory)
        expected = [f"hydra/launcher={launcher()}", f"hydra.launcher.n_jobs={count}"] if count > 1 else []
        assert in_processes(["jobs=auto"], pictures) == in_processes([], pictures) == expected
    monkeypatch.setattr(runtime, "free_memory", lambda: math.inf)
    assert in_processes(["jobs=auto"])[-1] == "hydra.launcher.n_jobs=5"
    monkeypatch.setattr(device, "device_of", lambda _: torch.device("cuda"))
    assert in_processes(["jobs=2"]) == ["hydra/launcher=joblib", "hydra.launcher.n_jobs=2"], (
        "CUDA does not survive a fork"
    )
    typed = ["hydra/launcher=dask"]
    assert (in_processes([]), in_processes(typed, 40)) == ([], typed)
