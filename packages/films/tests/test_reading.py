"""Films are read as they were written, as far as they go, or refused in a line."""

import logging
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from brushexp_films.clips import open_clip, timed_pictures
from films import encoded, scene

from brushexp.errors import UserError

av = pytest.importorskip("av")


@pytest.mark.parametrize("shape", [(64, 64), (33, 48), (32, 47)])
def test_a_film_is_read_as_it_was_written(tmp_path, shape):
    pictures = [picture[: shape[0], : shape[1]] for picture in scene(5)]
    clip = open_clip(encoded(tmp_path / "film.mp4", pictures, rate=24))
    even = tuple(side + side % 2 for side in shape)
    assert (clip.size, clip.rate, clip.count) == (even, Fraction(24), 5)
    frames = [shown.picture for shown in timed_pictures(clip)]
    assert [picture.shape for picture in frames] == [(*even, 3)] * 5
    for picture, original in zip(frames, pictures, strict=True):
        assert np.abs(picture[: shape[0], : shape[1]].astype(float) - original).mean() < 8


def test_a_film_that_breaks_off_is_read_as_far_as_it_goes(tmp_path, caplog):
    path = encoded(tmp_path / "film.mp4", 4 * scene(10))
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    with caplog.at_level(logging.WARNING):
        count = len(list(timed_pictures(open_clip(path))))
    assert 0 < count < 40
    assert str(count) in caplog.text


def sound(path):
    with av.open(str(path), "w") as container:
        stream = container.add_stream("aac", rate=44100)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), format="fltp", layout="mono")
        frame.rate = 44100
        container.mux([*stream.encode(frame), *stream.encode()])


def cut(path):
    with av.open(str(path), "w") as container:  # what players need is written last
        stream = container.add_stream("libx264", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        picture = av.VideoFrame.from_ndarray(np.zeros((48, 64, 3), np.uint8), format="rgb24")
        container.mux([*stream.encode(picture), *stream.encode()])
    path.write_bytes(path.read_bytes()[:-200])


def without_its_list(path):
    path.write_bytes(b"\0\0\0\x14ftypisom\0\0\2\0isom\0\0\0\0mdat" + bytes(999))


@pytest.mark.parametrize(("make", "message"), [
    (without_its_list, r"lacks the list of its pictures \(moov\).* was broken off; copy it again, or mend it"),
    (lambda path: None, "no file"),
    (Path.mkdir, "folder"),
    (Path.touch, r"is empty \(0 bytes\); give a file that holds a film"),
    (lambda path: path.write_text("not a film"), r"cannot be read as a film \(Invalid data"),
    (cut, "is cut short: its file ends before the film does; get the whole file"),
    (sound, "no video"),
])  # fmt: skip
def test_what_is_no_film_is_refused_in_one_line(tmp_path, make, message):
    make(tmp_path / "clip.mp4")
    with pytest.raises(UserError, match=message) as caught:
        open_clip(tmp_path / "clip.mp4")
    assert "\n" not in str(caught.value)


def test_without_the_library_a_film_says_what_to_install(tmp_path, monkeypatch):
    path = encoded(tmp_path / "clip.mp4", scene(1))
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(UserError, match=r"brushexp\[video\]"):
        open_clip(path)
