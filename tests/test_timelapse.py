"""The timelapse keeps few, small frames, survives a checkpoint, and becomes a video or a GIF."""

import io
import sys
from itertools import pairwise

import numpy as np
import pytest
import torch
from PIL import Image

from brushexp.errors import UserError
from brushexp.paint.timelapse import FPS, HOLD, Timelapse, moments, shrink

COLORS = [(0.85, 0.15, 0.1), (0.1, 0.7, 0.25), (0.1, 0.25, 0.8), (0.95, 0.85, 0.3)]


def plain(color: tuple[float, ...], height: int = 48, width: int = 64) -> torch.Tensor:
    return torch.tensor(color)[:, None, None].expand(3, height, width)


def filled(n_frames: int = 4, side: int = 64) -> Timelapse:
    timelapse = Timelapse(n_frames, side)
    for step, color in enumerate(COLORS):
        timelapse.add(plain(color), step)
    return timelapse


def decoded(path):
    av = pytest.importorskip("av")
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)], stream


@pytest.fixture
def no_av(monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)


def test_the_video_shows_the_frames_and_holds_the_last(tmp_path):
    path = filled().write(tmp_path)
    assert path == tmp_path / "timelapse.mp4"
    frames, stream = decoded(path)
    assert len(frames) == len(COLORS) + round(HOLD * FPS)
    assert stream.average_rate == FPS
    assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
    for frame, color in zip(frames, [*COLORS, COLORS[-1]], strict=False):
        assert frame.shape == (48, 64, 3)
        np.testing.assert_allclose(frame.mean((0, 1)) / 255, color, atol=0.02)
    assert [file.name for file in tmp_path.iterdir()] == ["timelapse.mp4"]


def test_the_video_says_which_colours_it_means(tmp_path):
    _, stream = decoded(filled().write(tmp_path))
    assert stream.codec_context.colorspace == stream.codec_context.color_primaries == 1  # BT.709


def test_the_video_can_be_played_while_it_loads(tmp_path):
    data = filled().write(tmp_path).read_bytes()
    assert data.index(b"moov") < data.index(b"mdat")


@pytest.mark.usefixtures("no_av")
def test_without_av_a_gif_is_written(tmp_path):
    path = filled(side=720).write(tmp_path)
    assert path == tmp_path / "timelapse.gif"
    with Image.open(path) as gif:
        assert gif.n_frames == len(COLORS)
        durations = []
        for k, color in enumerate(COLORS):
            gif.seek(k)
            durations.append(gif.info["duration"])
            np.testing.assert_allclose(np.asarray(gif.convert("RGB")).mean((0, 1)) / 255, color, atol=0.03)
        assert durations[-1] == 1000 * HOLD
        assert max(durations[:-1]) < 100


@pytest.mark.usefixtures("no_av")
def test_a_gif_is_small(tmp_path):
    timelapse = Timelapse(60, 720)
    for step in range(60):
        noise = torch.rand(3, 90, 120).repeat_interleave(6, 1).repeat_interleave(6, 2)
        timelapse.add(noise, step)
    path = timelapse.write(tmp_path)
    with Image.open(path) as gif:
        assert gif.size == (320, 240)
    assert path.stat().st_size < 6e6


def test_a_build_of_av_without_an_encoder_means_a_gif(tmp_path, monkeypatch):
    av = pytest.importorskip("av")
    monkeypatch.setattr(av, "codecs_available", {"mpeg4"})
    assert filled().write(tmp_path).suffix == ".gif"


@pytest.mark.parametrize("shape", [(1, 1), (4, 20000), (20000, 4), (63, 91), (2, 3)])
@pytest.mark.parametrize("video", [True, False])
def test_pictures_of_every_shape_become_a_timelapse(tmp_path, shape, video, monkeypatch):
    if not video:
        monkeypatch.setitem(sys.modules, "av", None)
    timelapse = Timelapse(3, 80)
    for step in range(3):
        timelapse.add(torch.rand(3, *shape), step)
    path = timelapse.write(tmp_path)
    assert path.suffix == (".mp4" if video else ".gif")
    if video:
        assert len(decoded(path)[0]) == 3 + round(HOLD * FPS)


@pytest.mark.parametrize(
    ("shape", "side", "size"),
    [
        ((100, 200), 80, (80, 40)),
        ((101, 203), 720, (202, 100)),
        ((1, 1), 80, (2, 2)),
        ((4, 20000), 80, (80, 2)),
        ((3000, 1000), 501, (166, 500)),
    ],
)
def test_frames_are_even_and_fit(shape, side, size):
    assert shrink(torch.rand(3, *shape), side).size == size


def test_shrinking_averages_and_does_not_shift():
    ramp = torch.linspace(0, 1, 1200).expand(3, 900, 1200)
    row = np.asarray(shrink(ramp, 100))[40, :, 0] / 255
    np.testing.assert_allclose(row, (np.arange(100) + 0.5) / 100, atol=0.01)


def test_a_picture_with_a_gradient_is_left_alone():
    image = torch.rand(3, 8, 8, requires_grad=True)
    Timelapse(2, 8).add(image * 2, 0)
    assert image.grad is None


@pytest.mark.parametrize("n_steps", [0, 1, 5, 59, 60, 61, 500, 3000, 100_000])
@pytest.mark.parametrize("n_frames", [1, 2, 10, 60])
def test_the_right_number_of_frames_is_due_first_and_last_among_them(n_frames, n_steps):
    timelapse = Timelapse(n_frames, 64)
    due = [step for step in range(n_steps + 1) if timelapse.due(step, n_steps)]
    assert len(due) == min(max(n_frames, 2), n_steps + 1)
    assert due[0] == 0
    assert due[-1] == n_steps


def test_early_progress_is_shown_more_densely():
    due = sorted(moments(60, 500))
    gaps = np.diff(due)
    assert gaps[0] == 1
    assert gaps[-1] > 10
    assert all(later >= earlier - 1 for earlier, later in pairwise(gaps))  # up to rounding


def test_zero_frames_switch_it_off(tmp_path):
    timelapse = Timelapse(0, 64)
    assert not any(timelapse.due(step, 10) for step in range(11))
    timelapse.add(torch.rand(3, 8, 8), 0)
    assert timelapse.write(tmp_path) is None
    assert not list(tmp_path.iterdir())


def test_nothing_is_written_before_the_first_frame(tmp_path):
    assert Timelapse(5, 64).write(tmp_path) is None


@pytest.mark.parametrize(("n_frames", "side", "key"), [(-1, 64, "frames"), (10**6, 64, "frames"), (5, 0, "frame_side")])
def test_impossible_wishes_are_refused(n_frames, side, key):
    with pytest.raises(UserError, match=f"^{key} is .*; choose"):
        Timelapse(n_frames, side)


def test_a_resumed_run_has_all_frames(tmp_path):
    straight = filled()
    first, second = Timelapse(4, 64), Timelapse(4, 64)
    for step in (0, 1, 2):
        first.add(plain(COLORS[step]), step)
    file = io.BytesIO()
    torch.save({"timelapse": first.state_dict()}, file)
    file.seek(0)
    second.load_state_dict(torch.load(file, weights_only=True)["timelapse"])
    for step in (2, 3):  # step 2 again: it came after the checkpoint of step 1
        second.add(plain(COLORS[step]), step)
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    assert straight.write(tmp_path / "a").read_bytes() == second.write(tmp_path / "b").read_bytes()


def test_frames_are_kept_compressed():
    timelapse = Timelapse(10, 512)
    smooth = torch.nn.functional.interpolate(torch.rand(1, 3, 16, 16), size=(512, 512), mode="bilinear")[0]
    for step in range(10):
        timelapse.add(smooth, step)
    assert sum(frame.numel() for frame in timelapse.state_dict()["frames"]) < 10 * 50_000
