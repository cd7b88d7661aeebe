"""Tests that threads, forks and jobs do not disturb each other, and that files are written whole or not at all."""

import importlib
import json
import math
import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import torch
from lightning_utilities.core.imports import RequirementCache
from omegaconf import OmegaConf
from PIL import Image
from refusals import refusal, refuses
from scenes import random_strokes

from brushexp.compat.hidden_packages import hide_packages
from brushexp.painting.timelapse import Timelapse
from brushexp.runs.runner import explaining_to_users
from brushexp.strokes.storage import Saved, save_catalogue
from brushexp.system import runtime
from brushexp.system.files import replacing, to_bytes, write_bytes, write_json, write_picture
from brushexp.system.reading import yaml_of
from brushexp.system.runtime import end_on_signals, forget_peak_memory, peak_memory, share

SCRIPT = """
import sys
import brushexp
import torch
from brushexp.plugins.blend.tiled import Tiled
Tiled()
assert "numba" not in sys.modules, "it takes a second to import, and comes with the first call of a kernel"
torch.set_num_threads(1)
from brushexp_training.engine.disc import Disc
Disc(window=8)(torch.zeros(2, 10), seed=0)
assert torch.get_num_threads() == 1
"""
FORKS = """
import multiprocessing
import brushexp
import torch

def paint(seed):
    torch.rand(2**20).exp()  # by all threads
    painting = brushexp.paint("astronaut", strokes=40, resolution=32, steps=2, seed=seed, threads=2, look="plain")
    return painting.strokes.position.numpy().tobytes()

if __name__ == "__main__":
    own = paint(0)
    with multiprocessing.get_context("fork").Pool(2) as pool:
        assert pool.map(paint, [0, 0, 1])[:2] == [own, own]
"""


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere libraries do not survive a fork")
def test_kernels_are_loaded_at_their_first_call_and_a_fork_paints_after_a_painting():
    subprocess.run([sys.executable, "-c", SCRIPT], check=True)
    for usual in ("1", "2"):  # default number of threads
        environment = os.environ | {"OMP_NUM_THREADS": usual}
        subprocess.run([sys.executable, "-c", FORKS], check=True, env=environment)


@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize("n", [0, 1, 2, 7, 100])
def test_threads_share_all_work_and_do_nothing_twice(threads, n, monkeypatch):
    monkeypatch.setattr("torch.get_num_threads", lambda: threads)
    done = np.zeros(n, int)

    def work(begin, end, step):
        done[begin:end] += step

    share(work, n, 1)
    assert (done == 1).all()


def test_a_mistake_in_any_thread_is_told_and_work_is_done_where_no_more_threads_are_to_be_had(monkeypatch):
    monkeypatch.setattr("torch.get_num_threads", lambda: 3)

    def work(begin, end):
        time.sleep(0.001)  # so that all threads take part
        assert end < 50

    with pytest.raises(AssertionError):
        share(work, 50)
    monkeypatch.setattr("torch.get_num_threads", lambda: 3)
    monkeypatch.setattr(runtime, "_pool", lambda: ended)
    ended, done = ThreadPoolExecutor(1), np.zeros(9, int)
    ended.shutdown()
    share(lambda begin, end: done[begin:end].__iadd__(1), 9)
    assert (done == 1).all()


def test_an_interruption_that_a_callback_loses_comes_again(monkeypatch):
    monkeypatch.setattr("brushexp.system.runtime.ENDING", [])
    monkeypatch.setattr(sys, "unraisablehook", lambda lost: others.append(lost.exc_type))
    others = []

    class Lost:
        def __init__(self, error):
            self.error = error

        def __del__(self):
            raise self.error

    end_on_signals()
    Lost(ValueError())
    with pytest.raises(KeyboardInterrupt):  # noqa: PT012
        Lost(KeyboardInterrupt())
        time.sleep(20)
    assert others == [ValueError]
    with pytest.raises(KeyboardInterrupt), explaining_to_users(OmegaConf.create()):  # noqa: PT012
        Lost(KeyboardInterrupt())
        raise RuntimeError("no compiled object yet")
    time.sleep(2 * runtime.MOMENT)  # it is not raised again


def test_the_peak_of_a_job_is_not_that_of_one_before_it():
    forget_peak_memory()
    before = peak_memory() or runtime._earlier_peak[0]
    np.ones(2**29, np.uint8)
    first = peak_memory()
    assert first is None or 500 < first < before + 600
    forget_peak_memory()
    np.ones(2**20, np.uint8)
    assert (peak_memory() or 0) < (first or np.inf), "systems that cannot forget say that they do not know"


def test_a_hidden_package_looks_as_if_it_were_not_installed_to_lightning_alone_and_a_loaded_one_stays():
    assert "xmlrpc" not in sys.modules
    with hide_packages("xmlrpc", "mkdocs", "torch"):
        assert not RequirementCache("mkdocs>=0.1")
        assert not RequirementCache(module="xmlrpc.client")
        assert RequirementCache("torch>=2")
        importlib.import_module("xmlrpc.server")  # a task may need it
    assert find_spec("xmlrpc") is not None
    assert RequirementCache("mkdocs>=0.2")


def write_old(path: Path) -> Path:
    path.write_text("old")
    return path


@pytest.fixture
def full_disk():
    """Limit each file that this process writes to 10 kB, to imitate a full disk."""
    resource = pytest.importorskip("resource")  # not on Windows
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("name", ["painting.png", "metrics.json", "catalogue.h5", "timelapse.mp4"])
@pytest.mark.usefixtures("full_disk")
def test_a_full_disk_is_explained_and_leaves_the_previous_file(name, tmp_path):
    path, picture, timelapse = write_old(tmp_path / name), torch.rand(3, 128, 128), Timelapse(4, 128)
    for step in range(4):
        timelapse.add(picture, step)
    saved = Saved(random_strokes(2000, (8, 8)), torch.arange(2000), (8, 8), torch.ones(3), "analytic", "", 0, "a: 1")
    write = {
        "painting.png": lambda: write_picture(path, picture),
        "metrics.json": lambda: write_json(path, list(range(10_000))),
        "catalogue.h5": lambda: save_catalogue(path, saved),
        "timelapse.mp4": lambda: timelapse.write(tmp_path),
    }[name]
    reason = "File too large; fix that or choose another folder with output=..."
    assert refusal(write) == f"cannot write {path}: {reason}"
    assert os.listdir(tmp_path) == [name]
    assert path.read_text() == "old"


@pytest.mark.parametrize("failure", [None, KeyboardInterrupt, RuntimeError, SystemExit])
def test_the_new_file_takes_the_place_of_the_old_one_unless_anything_fails(tmp_path, failure):
    path = write_old(tmp_path / "table.csv")
    with pytest.raises(failure) if failure else nullcontext(), replacing(path) as temporary:
        assert temporary.parent == tmp_path
        assert temporary.name.startswith(".")
        assert temporary.suffix == ".csv"
        temporary.write_text("new")
        assert path.read_text() == "old"
        if failure:
            raise failure
    assert path.read_text() == ("old" if failure else "new")
    assert os.listdir(tmp_path) == ["table.csv"]


def test_a_place_that_cannot_be_written_is_explained_and_a_very_long_name_is_no_obstacle(tmp_path):
    words = r"cannot write .*metrics.json: No such file.*; fix that or .*output="
    refuses(words, write_json, tmp_path / "missing" / "metrics.json", {})
    file = write_old(tmp_path / "file")
    refuses(r"Not a directory; fix that or choose another folder with output=", write_json, file / "metrics.json", {})
    (tmp_path / "folder").mkdir()
    refuses(r"cannot write .*folder: Is a directory", write_json, tmp_path / "folder", {})
    assert sorted(os.listdir(tmp_path)) == ["file", "folder"]
    path = tmp_path / ("ä" * 120 + ".txt")
    write_bytes(path, b"x")
    (tmp_path / "b").write_bytes(b"")
    assert path.read_bytes() == b"x"
    assert path.stat().st_mode == (tmp_path / "b").stat().st_mode


def test_json_is_strict_keeps_letters_and_survives_odd_file_names(tmp_path):
    data = {"psnr": math.inf, "ssim": np.float32(0.5), "l": (math.nan, np.float64(math.nan), 1), 3: Path("a") / "b"}
    names = {"image": "größe.png", "odd": "\udcff.png"}
    write_json(tmp_path / "a.json", data | names)
    text = (tmp_path / "a.json").read_text("utf-8")
    read = json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))
    assert read == {"psnr": None, "ssim": 0.5, "l": [None, None, 1], "3": str(Path("a") / "b")} | names
    assert "größe" in text
    assert yaml_of(OmegaConf.to_yaml(OmegaConf.create(names))) == names, "and so do settings"


def test_rounding_to_bytes_clips_and_rounds_halves_up_and_every_byte_is_written(tmp_path):
    values = torch.tensor([-1.0, 0.0, 0.5 / 255, 0.499 / 255, 127.5 / 255, 1.0, 2.0, math.nan, math.inf, -math.inf])
    pixels = to_bytes(values.expand(3, 1, -1))
    assert (pixels.dtype, pixels.shape) == (np.uint8, (1, 10, 3))
    assert pixels[0, :, 0].tolist() == [0, 0, 1, 0, 128, 255, 255, 0, 255, 0]
    for dtype in (torch.float16, torch.bfloat16, torch.float64):
        assert (to_bytes(torch.full((3, 2, 5), 0.5, dtype=dtype)) == 128).all()
    levels = torch.arange(256)
    image = (levels / 255).reshape(1, 8, 32).repeat(3, 1, 1).requires_grad_()
    before = image.detach().clone()
    assert to_bytes(image)[..., 1].reshape(-1).tolist() == levels.tolist()
    for name, picture in (("a.png", image), ("b.png", to_bytes(image))):
        write_picture(tmp_path / name, picture)
        with Image.open(tmp_path / name) as read:
            assert (read.format, read.mode, read.size) == ("PNG", "RGB", (32, 8))
            np.testing.assert_array_equal(np.asarray(read), to_bytes(image))
    assert torch.equal(image, before), "the picture is left alone"
