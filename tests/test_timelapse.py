"""The timelapse keeps few, small frames, survives a checkpoint, and becomes a video or a GIF."""

from itertools import pairwise

import numpy as np
import pytest
import torch
from films import decoded, unrolled

from brushexp.errors import UserError
from brushexp.painting.timelapse import FPS, HOLD_SECONDS, MIN_FPS, Timelapse, moments, shrink, timing
from brushexp.pictures.video import MOST_FPS

COLORS = [(0.85, 0.15, 0.1), (0.1, 0.7, 0.25), (0.1, 0.25, 0.8), (0.95, 0.85, 0.3)]


def filled(steps=range(4), side: int = 64, size: tuple[int, int] = (48, 64), **options) -> Timelapse:
    timelapse = Timelapse(4, side, **options)
    for step in steps:
        timelapse.add(torch.tensor(COLORS[step])[:, None, None].expand(3, *size), step)
    return timelapse


def test_the_video_shows_the_frames_and_holds_the_last(tmp_path):
    (path,) = filled().write(tmp_path)
    assert path == tmp_path / "timelapse.mp4"
    frames, rate = decoded(path)
    assert len(frames) == len(COLORS) + round(HOLD_SECONDS * FPS)
    assert rate == FPS
    for frame, color in zip(frames, [*COLORS, COLORS[-1]], strict=False):
        assert frame.shape == (48, 64, 3)
        np.testing.assert_allclose(frame.mean((0, 1)) / 255, color, atol=0.02)
    assert [file.name for file in tmp_path.iterdir()] == ["timelapse.mp4"]
    with pytest.importorskip("av").open(str(path)) as container:
        coding = container.streams.video[0].codec_context
        assert (coding.name, coding.pix_fmt) == ("h264", "yuv420p")
        assert coding.colorspace == coding.color_primaries == 1  # BT.709
    data = path.read_bytes()
    assert data.index(b"moov") < data.index(b"mdat"), "it can be played while it loads"


@pytest.mark.parametrize("shape", [(1, 1), (4, 20000), (20000, 4), (63, 91), (2, 3)])
def test_pictures_of_every_shape_become_a_timelapse_but_no_picture_none(tmp_path, shape):
    off = Timelapse(0, 64)
    off.add(torch.rand(3, *shape), 0)
    assert off.write(tmp_path) == Timelapse(5, 64).write(tmp_path) == [] == list(tmp_path.iterdir())
    resumed = Timelapse(4, 80, kind="both")
    torch.save(filled((0, 1, 2), side=80, size=shape).state_dict(), tmp_path / "state")
    resumed.load_state_dict(torch.load(tmp_path / "state", weights_only=True))
    resumed.add(torch.tensor(COLORS[3])[:, None, None].expand(3, *shape), 3)
    torch.testing.assert_close(resumed.state_dict(), filled(side=80, size=shape).state_dict())
    video, gif = resumed.write(tmp_path)
    assert len(decoded(video)[0]) == len(COLORS) + round(HOLD_SECONDS * FPS)
    assert len(unrolled(gif)[0]) == len(COLORS)


def test_frames_fit_small_pictures_stay_and_shrinking_averages_and_does_not_shift():
    sizes = {(100, 200, 80): (80, 40), (101, 203, 720): (203, 101), (1, 1, 80): (1, 1), (4, 20000, 80): (80, 1)}
    for (height, width, side), size in sizes.items():
        assert shrink(torch.rand(3, height, width, requires_grad=True), side).size == size
    ramp = torch.linspace(0, 1, 1200).expand(3, 900, 1200)
    row = np.asarray(shrink(ramp, 100))[40, :, 0] / 255
    np.testing.assert_allclose(row, (np.arange(100) + 0.5) / 100, atol=0.01)


@pytest.mark.parametrize("n_steps", [0, 1, 5, 59, 60, 61, 500, 3000, 100_000])
@pytest.mark.parametrize("n_frames", [1, 2, 10, 60])
def test_as_many_frames_as_asked_are_due_ever_fewer_and_the_first_and_last_step_among_them(n_frames, n_steps):
    due = sorted(moments(n_frames, n_steps))
    assert len(due) == min(max(n_frames, 2), n_steps + 1)
    assert (due[0], due[-1]) == (0, n_steps)
    assert all(later >= earlier - 1 for earlier, later in pairwise(np.diff(due)))  # up to rounding


@pytest.mark.parametrize("seconds", [0.5, 3.0, 7.3, 60.0])
def test_a_chosen_length_is_kept_and_players_can_follow(tmp_path, seconds):
    for n_frames in (1, 2, 3, 11, 60, 2000):
        rate, ticks = timing(n_frames, seconds)
        assert MIN_FPS <= rate <= MOST_FPS
        assert rate == MOST_FPS or abs(ticks * n_frames / rate - seconds) < 1e-3 * seconds
    for impossible in (0.0, -seconds, 1.1, 301.0, float("nan")):
        with pytest.raises(UserError, match=r"^timelapse_seconds is .*; choose 1.2 to 300 for 60 frames$"):
            Timelapse(60, 64, seconds=impossible)
    video, gif = filled(side=16, size=(8, 12), seconds=seconds, kind="both").write(tmp_path)
    frames, rate = decoded(video)
    assert abs(len(frames) / rate - seconds - HOLD_SECONDS) < 0.1
    assert abs(sum(unrolled(gif)[1]) / 1000 - seconds - HOLD_SECONDS) < 0.1
    ticks = (len(frames) - round(HOLD_SECONDS * rate)) // len(COLORS)
    for k, color in enumerate(COLORS):  # each for the same time
        np.testing.assert_allclose(frames[k * ticks + ticks // 2].mean((0, 1)) / 255, color, atol=0.02)
