"""Test that a painting keeps a limited number of pictures, and that a removed picture is replaced by the next one."""

import io

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("nicegui", reason="the studio is an extra")
from brushexp_studio.wishes import Wishes
from brushexp_studio.works import GLANCE, MOST_FRAMES, Work


def grey_of(jpeg):
    return np.asarray(Image.open(io.BytesIO(jpeg)))[0, 0, 0]


def test_a_picture_that_was_removed_is_shown_by_the_next_one_that_is_left(tmp_path):
    work = Work(1, Wishes(), tmp_path)
    for number in range(MOST_FRAMES + 1):
        work.add_frame(np.full((8, 8, 3), number, np.uint8), f"step {number}")
    assert len(work.frames) < MOST_FRAMES
    for number in range(MOST_FRAMES + 1):
        shown = int(grey_of(work.jpeg(number)))
        assert number - 2 <= shown <= number + 3  # rounding by JPEG
    assert work.jpeg(1) == work.jpeg(2) == work.frames[2][0]
    assert work.jpeg(GLANCE) == work.frames[0][0]
    with pytest.raises(KeyError):
        work.jpeg(MOST_FRAMES + 1)
