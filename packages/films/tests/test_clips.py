"""Test that films from phones, browsers, recorders and studios can be read, or fail with a one-line error."""

import logging
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from brushexp_films import task
from brushexp_films.clips import is_moving, open_clip, pictures_between, timed_pictures
from brushexp_films.sound import add_sound
from films import decoded, encoded, scene
from PIL import Image
from refusals import refuses
from signals import TO_BT2020, hlg, pq, srgb

from brushexp.cli.program import expand_arguments
from brushexp.pictures.load import load_picture

av = pytest.importorskip("av")
TICK = Fraction(1, 1000)


def coded(path: Path, codec: str, form: str, frames: list[np.ndarray], times: list[int] | None = None, **said) -> Path:
    """Encode frames in the pixel format ``form`` as a film, with times in milliseconds and other codec settings."""
    options = said.pop("options", {})
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25, options=options)
        first = av.VideoFrame.from_ndarray(frames[0], format=form)
        stream.width, stream.height, stream.pix_fmt = first.width, first.height, said.pop("pix_fmt", form)
        stream.codec_context.time_base = TICK
        for name, value in said.items():
            setattr(stream.codec_context, name, value)
        for number, pixels in enumerate(frames):
            frame = av.VideoFrame.from_ndarray(pixels, format=form)
            frame.pts, frame.time_base = (times[number] if times else 40 * number), TICK
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


@pytest.mark.parametrize(("curve", "transfer"), [(pq, 16), (hlg, 18)])
def test_films_of_high_dynamic_range_are_shown_with_their_white_as_white(tmp_path, curve, transfer):
    light = np.array([[1, 1, 1], [0.2, 0.2, 0.2], [0.7, 0.03, 0.03], [0.05, 0.4, 0.1], [0.02, 0.05, 0.5]])
    red, green, blue = curve(light[None] @ np.array(TO_BT2020).T)[0].T
    y = 0.2627 * red + 0.6780 * green + 0.0593 * blue
    levels = [64 + 876 * y, 512 + 896 * (blue - y) / 1.8814, 512 + 896 * (red - y) / 1.4746]  # BT.2100, 10 bits
    frame = av.VideoFrame(80, 64, "yuv444p10le")
    for plane, level in zip(frame.planes, levels, strict=True):
        rows = np.rint(level).astype(np.uint16).repeat(16)[None].repeat(64, 0)
        plane.update(np.pad(rows, ((0, 0), (0, plane.line_size // 2 - 80))).tobytes())
    path = tmp_path / "phone.mkv"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=25)
        stream.width, stream.height, stream.pix_fmt, said = 80, 64, "yuv444p10le", stream.codec_context
        said.color_trc, said.color_primaries, said.colorspace, said.color_range = transfer, 9, 9, 1
        frame.pts, frame.time_base = 0, Fraction(1, 25)
        container.mux([*stream.encode(frame), *stream.encode()])
    picture = next(timed_pictures(open_clip(path))).picture
    np.testing.assert_allclose(picture[32, 8::16], 255 * srgb(light), atol=3)


TIMES = [0, 500, 533, 566, 1400, 1433]


def test_pictures_keep_their_times_and_pixels_that_are_not_square_are_made_so(tmp_path):
    clip = open_clip(coded(tmp_path / "phone.mp4", "libx264", "rgb24", scene(6), TIMES, pix_fmt="yuv420p"))
    shown = [(float(begin), float(end)) for _, begin, end in timed_pictures(clip)]
    assert [begin for begin, _ in shown] == pytest.approx([time / 1000 for time in TIMES], abs=2e-3)
    assert [end for _, end in shown[:-1]] == [begin for begin, _ in shown[1:]]
    part = [(float(begin), float(end)) for _, begin, end in pictures_between(clip, 0.52, 1.41, 2)]
    assert part == [pytest.approx(span, abs=2e-3) for span in ((0, 0.046), (0.046, 0.89))]
    frames = [np.ascontiguousarray(picture[:48]) for picture in scene(2)]
    said = {"pix_fmt": "yuv420p", "sample_aspect_ratio": Fraction(4, 3)}
    clip = open_clip(coded(tmp_path / "dv.mp4", "libx264", "rgb24", frames, **said))
    assert clip.size == (48, 85)
    picture = next(timed_pictures(clip)).picture
    wide = np.asarray(Image.fromarray(frames[0]).resize((85, 48), Image.Resampling.LANCZOS), float)
    assert np.abs(picture - wide).mean() < 8


def test_a_recording_of_a_browser_has_its_length_and_a_clock_that_begins_anew_ends_no_film(tmp_path, caplog):
    path = coded(
        tmp_path / "tab.webm", "libvpx-vp9", "yuv420p", [np.zeros((48, 32), np.uint8)] * 12, [80 * k for k in range(12)]
    )
    data = path.read_bytes()
    at = data.index(b"\x44\x89")  # length in the header, which recorders leave out
    path.write_bytes(data[:at] + b"\xec" + bytes([0x80 + data[at + 2] - 0x80 + 1]) + data[at + 3 :])
    clip = open_clip(path)
    assert float([*timed_pictures(clip)][-1].end) == pytest.approx(0.94, abs=0.03)
    assert clip.rate <= 50
    wrap = 95443_700  # milliseconds; clocks of transport streams have 33 bits and a tick of 1 / 90,000 s
    times = [wrap - 1000 + 40 * k for k in range(50)]
    clip = open_clip(coded(tmp_path / "tv.ts", "libx264", "rgb24", 10 * scene(5), times, pix_fmt="yuv420p"))
    shown = [*timed_pictures(clip)]
    assert float(shown[-1].end) == pytest.approx(2, abs=0.05)
    assert len(shown) == 50
    assert "of its header" not in caplog.text


def with_sound(path: Path, pictures: list[int], begin: int, tracks: int = 1) -> Path:
    """Write a film whose sound begins at ``begin`` milliseconds, with a tone from 500 to 600 ms into the sound."""
    with av.open(str(path), "w") as container:
        video = container.add_stream("libx264", rate=25)
        video.width, video.height, video.pix_fmt, video.codec_context.time_base = 64, 64, "yuv420p", TICK
        sounds = [container.add_stream("aac", rate=48_000, layout="mono") for _ in range(tracks)]
        packets = []
        for time, pixels in zip(pictures, scene(len(pictures)), strict=True):
            frame = av.VideoFrame.from_ndarray(pixels, format="rgb24")
            frame.pts, frame.time_base = time, TICK
            packets += video.encode(frame)
        packets += video.encode()
        wave = np.zeros((1, 48_000), np.float32)
        wave[:, 24_000:28_800] = np.sin(np.arange(4_800) / 8)
        for sound in sounds:
            for start in range(0, 46_080, 1024):
                frame = av.AudioFrame.from_ndarray(wave[:, start : start + 1024], format="fltp", layout="mono")
                frame.sample_rate, frame.pts, frame.time_base = 48_000, start + 48 * begin, Fraction(1, 48_000)
                packets += sound.encode(frame)
            packets += sound.encode()
        for packet in sorted(packets, key=lambda packet: packet.dts * packet.time_base):
            container.mux(packet)
    return path


def when_loud(path: Path) -> float:
    with av.open(str(path)) as container:
        for frame in container.decode(audio=0):
            if np.abs(frame.to_ndarray()).max() > 0.3:
                return frame.time
    return -1.0


def times_of(path: Path) -> list[float]:
    with av.open(str(path)) as container:
        return [frame.time for frame in container.decode(video=0)]


SOUND_BEGINS = {
    "late.ts": (5000, 5000), "picture.mp4": (500, 0), "sound.mkv": (0, 500)
}  # fmt: skip


@pytest.mark.parametrize("name", SOUND_BEGINS)
def test_sound_stays_in_step_wherever_the_clocks_begin(run_task, tmp_path, caplog, name):
    begin, heard = SOUND_BEGINS[name]
    path = with_sound(tmp_path / name, [begin + time for time in (0, 40, 600, 640)], heard)
    run_task(
        task, f"image={path}", "look=plain", "resolution=32", "strokes=9", "steps=1", "film.steps=0", "film.stop=4"
    )
    there, here = times_of(path), times_of(tmp_path / "film.mp4")
    assert np.diff(here) == pytest.approx(np.diff(there), abs=2e-3)
    assert here[0] == pytest.approx(max(0, begin - heard) / 1000, abs=0.021)
    if (begin, heard) != (0, 500):  # otherwise the film ends before the tone
        assert when_loud(tmp_path / "film.mp4") - here[0] == pytest.approx(when_loud(path) - there[0], abs=0.02)
    assert "of its header" not in caplog.text


@pytest.mark.parametrize(("codec", "form", "name"), [
    ("libvpx-vp9", "yuva420p", "a.webm"), ("prores_ks", "yuva444p10le", "a.mov"), ("qtrle", "argb", "a.mov"),
])  # fmt: skip
def test_what_is_transparent_lies_over_white_as_in_pictures(tmp_path, codec, form, name):
    pixels = np.zeros((64, 64, 4), np.uint8)
    pixels[..., 3] = np.repeat([0, 255], 32)
    frame = av.VideoFrame.from_ndarray(pixels, format="rgba").reformat(format=form)
    with av.open(str(tmp_path / name), "w") as container:
        stream = container.add_stream(codec, rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 64, form
        if codec == "libvpx-vp9":
            stream.metadata["alpha_mode"] = "1"
        frame.pts, frame.time_base = 0, Fraction(1, 25)
        container.mux([*stream.encode(frame), *stream.encode()])
    picture = next(timed_pictures(open_clip(tmp_path / name))).picture
    assert picture[32, 8].min() > 250
    assert picture[32, 56].max() < 5


@pytest.mark.parametrize("name", ["a.gif", "a.webp", "a.png", "a.avif"])
def test_pictures_that_move_are_films_and_their_first_one_is_told(run_task, tmp_path, caplog, monkeypatch, name):
    path, frames = tmp_path / name, [Image.fromarray(picture) for picture in scene(3)]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=[100, 40, 260])
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 1000)  # Pillow would refuse twice as many, but is not asked
    assert is_moving(path)
    monkeypatch.undo()
    assert "task=film" in expand_arguments([str(path)])
    assert "task=film" not in expand_arguments(["task=paint", f"image={path}"])
    spans = [(float(begin), float(end)) for _, begin, end in timed_pictures(open_clip(path))]
    assert spans == [pytest.approx(span, abs=2e-3) for span in ((0, 0.1), (0.1, 0.14), (0.14, 0.4))]
    if name == "a.gif":
        run_task(task, f"image={path}", "look=plain", "resolution=32", "strokes=9", "steps=1", "film.steps=0")
        assert times_of(tmp_path / "film.mp4") == pytest.approx([0, 0.1, 0.14], abs=2e-3)
    with caplog.at_level(logging.WARNING):
        load_picture(str(path), 16)
    assert f"is animated, and only its first frame is used; to paint it as a film, type: brushexp {path}" in caplog.text
    frames[0].save(path)
    assert not is_moving(path)


def test_tracks_that_are_left_out_a_picture_that_is_a_film_and_a_missing_library_are_told(
    tmp_path, caplog, monkeypatch
):
    source = with_sound(tmp_path / "two.mkv", [0, 40], 0, tracks=2)
    film = encoded(tmp_path / "film.mp4", scene(2))
    add_sound(film, source)
    assert "further tracks are left out (1 of sound)" in caplog.text
    assert len(decoded(film)[0]) == 2
    path = encoded(tmp_path / "clip.mp4", scene(1))
    refuses(r"clip.mp4 is a film, not a picture", load_picture, str(path), 16, key="style")
    path = encoded(tmp_path / "clip.mp4", scene(1))
    monkeypatch.setitem(sys.modules, "av", None)
    refuses(r"brushexp\[video\]", open_clip, path)


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
    with av.open(str(path), "w") as container:  # the list that players need is written last
        stream = container.add_stream("libx264", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        picture = av.VideoFrame.from_ndarray(np.zeros((48, 64, 3), np.uint8), format="rgb24")
        container.mux([*stream.encode(picture), *stream.encode()])
    path.write_bytes(path.read_bytes()[:-200])


def without_its_list(path):
    path.write_bytes(b"\0\0\0\x14ftypisom\0\0\2\0isom\0\0\0\0mdat" + bytes(999))


@pytest.mark.parametrize(("make", "message"), [
    (without_its_list, r"lacks the list of its pictures \(moov\).* was interrupted; copy it again, or repair it"),
    (lambda path: None, "no file"),
    (Path.mkdir, "folder"),
    (Path.touch, r"is empty \(0 bytes\); give a file that contains a film"),
    (lambda path: path.write_text("not a film"), r"cannot be read as a film \(Invalid data"),
    (cut, "is cut short: its file ends before the film does; get the whole file"),
    (sound, "no video"),
])  # fmt: skip
def test_what_is_no_film_is_refused_in_one_line(tmp_path, make, message):
    make(tmp_path / "clip.mp4")
    refuses(message, open_clip, tmp_path / "clip.mp4")
