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
    command = [sys.executable, "-c", FULL_DISK, str(tmp_path)]
    threads = os.environ | {"OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=threads)
    reason = "File too large; mend that or choose another folder with output=..."
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


@pytest.mark.parametrize("failure", [KeyboardInterrupt, RuntimeError, SystemExit])
def test_any_failure_leaves_the_previous_file_and_no_other(tmp_path, failure):
    path = write_old(tmp_path / "table.csv")
    with pytest.raises(failure), replacing(path) as temporary:  # noqa: PT012
        temporary.write_text("half")
        raise failure
    assert os.listdir(tmp_path) == ["table.csv"]
    assert path.read_text() == "old"


def test_permissions_are_the_usual_and_a_very_long_name_is_no_obstacle(tmp_path):
    path = tmp_path / ("ä" * 120 + ".txt")
    write_bytes(path, b"x")
    (tmp_path / "b").write_bytes(b"")
    assert path.read_bytes() == b"x"
    assert path.stat().st_mode == (tmp_path / "b").stat().st_mode


def test_a_place_that_cannot_be_written_is_explained(tmp_path):
    with pytest.raises(UserError, match=r"cannot write .*metrics.json: No such file.*; mend that or .*output="):
        write_json(tmp_path / "missing" / "metrics.json", {})
    file = write_old(tmp_path / "file")
    with pytest.raises(UserError, match=r"Not a directory; mend that or choose another folder with output="):
        write_json(file / "metrics.json", {})
    (tmp_path / "folder").mkdir()
    with pytest.raises(UserError, match=r"cannot write .*folder: Is a directory"):
        write_json(tmp_path / "folder", {})
    assert sorted(os.listdir(tmp_path)) == ["file", "folder"]


def test_json_is_strict_keeps_letters_and_survives_odd_file_names(tmp_path):
    data = {"psnr": math.inf, "ssim": np.float32(0.5), "l": (math.nan, np.float64(math.nan), 1), 3: Path("a") / "b"}
    names = {"image": "größe.png", "odd": "\udcff.png"}
    write_json(tmp_path / "a.json", data | names)
    text = (tmp_path / "a.json").read_text("utf-8")
    read = json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))
    assert read == {"psnr": None, "ssim": 0.5, "l": [None, None, 1], "3": str(Path("a") / "b")} | names
    assert "größe" in text


def test_rounding_to_bytes_clips_and_rounds_halves_up():
    values = torch.tensor([-1.0, 0.0, 0.5 / 255, 0.499 / 255, 127.5 / 255, 1.0, 2.0, math.nan, math.inf, -math.inf])
    pixels = to_bytes(values.expand(3, 1, -1))
    assert pixels.dtype == np.uint8
    assert pixels.shape == (1, 10, 3)
    assert pixels[0, :, 0].tolist() == [0, 0, 1, 0, 128, 255, 255, 0, 255, 0]

    for dtype in (torch.float16, torch.bfloat16, torch.float64):
        assert (to_bytes(torch.full((3, 2, 5), 0.5, dtype=dtype)) == 128).all()


def test_every_byte_is_written_and_the_picture_left_alone(tmp_path):
    levels = torch.arange(256)
    image = (levels / 255).reshape(1, 8, 32).repeat(3, 1, 1).requires_grad_()
    before = image.detach().clone()
    assert to_bytes(image)[..., 1].reshape(-1).tolist() == levels.tolist()
    torch.testing.assert_close(image.detach(), before, rtol=0, atol=0)
    write_picture(tmp_path / "a.png", image)
    write_picture(tmp_path / "b.png", to_bytes(image))
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    with Image.open(tmp_path / "a.png") as read:
        assert (read.format, read.mode, read.size) == ("PNG", "RGB", (32, 8))
        np.testing.assert_array_equal(np.asarray(read), to_bytes(image))
