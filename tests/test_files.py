"""Files are written whole or not at all."""

import json
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from brushexp.errors import UserError
from brushexp.system.files import replacing, to_bytes, write_bytes, write_json, write_picture

FULL_DISK = """
import resource, sys
from pathlib import Path
import numpy as np, torch
from brushexp.errors import UserError
from brushexp.system.files import write_json, write_picture
from brushexp.painting.timelapse import Timelapse
from brushexp.strokes.catalogue import FIELDS, Strokes
from brushexp.strokes.storage import Saved, save_catalogue

folder = Path(sys.argv[1])
noise = np.random.default_rng(0).integers(0, 256, (128, 128, 3), np.uint8)
strokes = Strokes(**{name: torch.rand(field.shape(2000)) + 0.001 for name, field in FIELDS.items()}).map(
    lambda value: value.clamp(max=1.0)
)
saved = Saved(strokes, torch.arange(2000), (8, 8), torch.ones(3), "analytic", "", 0, "a: 1")
timelapse = Timelapse(4, 128)
for step in range(4):
    timelapse.add(torch.from_numpy(noise).permute(2, 0, 1) / 255, step)
resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000))
jobs = {
    "painting.png": lambda path: write_picture(path, noise),
    "metrics.json": lambda path: write_json(path, list(range(10_000))),
    "catalogue.h5": lambda path: save_catalogue(path, saved),
    "timelapse.mp4": lambda path: timelapse.write(path.parent),
}
for name, write in jobs.items():
    try:
        write(folder / name)
    except UserError as error:
        print(error)
"""


def write_old(path: Path) -> Path:
    path.write_text("old")
    return path


@pytest.mark.skipif(sys.platform == "win32", reason="needs a limit on the size of files")
def test_a_full_disk_is_explained_and_leaves_the_previous_files(tmp_path):
    names = ["catalogue.h5", "metrics.json", "painting.png", "timelapse.mp4"]
    for name in names:
        write_old(tmp_path / name)
    done = subprocess.run(
        [sys.executable, "-c", FULL_DISK, str(tmp_path)],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
    )
    reason = "File too large; free some space or choose another folder with output=..."
    assert sorted(done.stdout.splitlines()) == [f"cannot write {tmp_path / name}: {reason}" for name in names]
    assert sorted(os.listdir(tmp_path)) == names
    assert {(tmp_path / name).read_text() for name in names} == {"old"}


def test_the_new_file_takes_the_place_of_the_old_one(tmp_path):
    path = write_old(tmp_path / "table.csv")
    with replacing(path) as temporary:
        assert temporary.parent == tmp_path
        assert temporary.name.startswith(".")
        assert temporary.suffix == ".csv"
        temporary.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert os.listdir(tmp_path) == ["table.csv"]


@pytest.mark.parametrize("failure", [KeyboardInterrupt, RuntimeError("bug"), SystemExit])
def test_any_failure_leaves_the_previous_file_and_no_other(tmp_path, failure):
    path = write_old(tmp_path / "table.csv")
    with pytest.raises(failure if isinstance(failure, type) else type(failure)), replacing(path) as temporary:  # noqa: PT012
        temporary.write_text("half")
        raise failure
    assert os.listdir(tmp_path) == ["table.csv"]
    assert path.read_text() == "old"


def test_a_file_with_the_usual_permissions_comes_out(tmp_path):
    write_bytes(tmp_path / "a", b"")
    (tmp_path / "b").write_bytes(b"")
    assert (tmp_path / "a").stat().st_mode == (tmp_path / "b").stat().st_mode


def test_a_very_long_name_is_no_obstacle(tmp_path):
    path = tmp_path / ("ä" * 120 + ".txt")
    write_bytes(path, b"x")
    assert path.read_bytes() == b"x"


def test_a_place_that_cannot_be_written_is_explained(tmp_path):
    with pytest.raises(UserError, match=r"cannot write .*metrics.json: No such file.*; create its folder .*output="):
        write_json(tmp_path / "missing" / "metrics.json", {})
    file = write_old(tmp_path / "file")
    with pytest.raises(UserError, match=r"Not a directory; choose another folder with output="):
        write_json(file / "metrics.json", {})
    (tmp_path / "folder").mkdir()
    with pytest.raises(UserError, match=r"cannot write .*folder: Is a directory"):
        write_json(tmp_path / "folder", {})
    assert sorted(os.listdir(tmp_path)) == ["file", "folder"]


def test_numbers_that_are_not_finite_become_null(tmp_path):
    data = {"psnr": math.inf, "ssim": np.float32(0.5), "l": (math.nan, np.float64(math.nan), 1), 3: Path("a") / "b"}
    write_json(tmp_path / "a.json", data)
    text = (tmp_path / "a.json").read_text()
    read = json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))
    assert read == {"psnr": None, "ssim": 0.5, "l": [None, None, 1], "3": str(Path("a") / "b")}


def test_json_keeps_letters_and_survives_odd_file_names(tmp_path):
    write_json(tmp_path / "a.json", {"image": "größe.png", "odd": "\udcff.png"})
    data = (tmp_path / "a.json").read_bytes()
    assert "größe" in data.decode()
    assert json.loads(data) == {"image": "größe.png", "odd": "\udcff.png"}


def test_rounding_to_bytes_clips_and_rounds_halves_up():
    values = torch.tensor([-1.0, 0.0, 0.5 / 255, 0.499 / 255, 127.5 / 255, 1.0, 2.0, math.nan, math.inf, -math.inf])
    pixels = to_bytes(values.expand(3, 1, -1))
    assert pixels.dtype == np.uint8
    assert pixels.shape == (1, 10, 3)
    assert pixels[0, :, 0].tolist() == [0, 0, 1, 0, 128, 255, 255, 0, 255, 0]


def test_rounding_returns_every_byte_and_leaves_the_picture_alone():
    levels = torch.arange(256)
    image = (levels / 255).reshape(1, 16, 16).repeat(3, 1, 1).requires_grad_()
    before = image.detach().clone()
    assert to_bytes(image)[..., 1].reshape(-1).tolist() == levels.tolist()
    torch.testing.assert_close(image.detach(), before, rtol=0, atol=0)


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16, torch.float64])
def test_rounding_takes_other_types(dtype):
    assert to_bytes(torch.full((3, 2, 5), 0.5, dtype=dtype)).tolist() == np.full((2, 5, 3), 128).tolist()


def test_pictures_are_written_as_they_are_rounded(tmp_path):
    image = torch.rand(3, 5, 7)
    write_picture(tmp_path / "a.png", image)
    write_picture(tmp_path / "b.png", to_bytes(image))
    with Image.open(tmp_path / "a.png") as a, Image.open(tmp_path / "b.png") as b:
        assert (a.format, a.mode, a.size) == ("PNG", "RGB", (7, 5))
        np.testing.assert_array_equal(np.asarray(a), to_bytes(image))
        np.testing.assert_array_equal(np.asarray(a), np.asarray(b))
