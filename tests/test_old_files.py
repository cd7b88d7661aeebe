"""Tests that files of version 0.1 still open: catalogues, a renderer's recipe and an interrupted run.

The files are in old_files/, along with that version's results. The run was stopped after 5 of its 12 steps. The same
run without interruption gave oil.png, the unlit painting:

    brushexp coffee resolution=24 strokes=9 steps=12 frames=0 report=false look=oil
"""

import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from program import ended

OLD = Path(__file__).parent / "old_files"


def assert_looks_like(painting: Path, expected: str) -> None:
    now, then = (np.asarray(Image.open(path), dtype=int) for path in (painting, OLD / expected))
    assert now.shape == then.shape
    assert abs(now - then).max() <= 1  # levels of 255: rounding differs between processors


@pytest.mark.parametrize(
    ("version", "picture"), [(1, "even.png"), (2, "even.png"), (3, "undrifting.png"), (4, "plain.png")]
)
def test_a_catalogue_of_each_version_looks_as_it_did(tmp_path, version, picture):
    code, output = ended(tmp_path, "task=export", "catalogue=" + str(OLD / f"catalogue_{version}.h5"), "output=again")
    assert code == 0, output
    assert_looks_like(tmp_path / "again" / "painting.png", picture)


def test_strokes_are_drawn_by_a_renderer_with_an_old_recipe(tmp_path):
    for name in ("neural.safetensors", "neural.json"):
        shutil.copy(OLD / name, tmp_path)
    tiny = [f"renderer.{option}" for option in ("window=16", "dense=4", "width=2", "code=1", "stages=1")]
    words = ["coffee", "resolution=24", "strokes=9", "steps=1", "renderer=neural", *tiny]
    code, output = ended(tmp_path, *words, "renderer.checkpoint=neural.safetensors", "output=painted")
    assert code == 0, output
    assert (tmp_path / "painted" / "painting.png").is_file()


def test_a_stopped_run_goes_on_to_the_painting_that_it_would_have_become(tmp_path):
    shutil.copytree(OLD / "stopped", tmp_path / "stopped")
    code, output = ended(tmp_path, "resume=stopped")
    assert code == 0, output
    assert_looks_like(tmp_path / "stopped" / "flat.png", "oil.png")
