"""Tests that films have the requested length and size, show their pictures, and survive checkpointing."""

import sys
import weakref
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
import torch
from films import decoded, unrolled
from PIL import Image
from refusals import refuses

from brushexp.painting.timelapse import FPS, HOLD_SECONDS, MIN_FPS, Timelapse, choose_ticks, moments, shrink
from brushexp.pictures.video import GIF_SIDE, GIF_TOLERANCE, LARGEST_SIDE, MOST_FPS, filming, largest_side


def smooth(seed: int, height: int = 40, width: int = 60) -> np.ndarray:
    """Make a picture of large, soft-edged patches."""
    few = np.random.default_rng(seed).integers(0, 256, (3, 4, 3), np.uint8)
    return np.asarray(Image.fromarray(few).resize((width, height), Image.Resampling.BICUBIC))


def film_of(pictures, folder, kind, ticks=1, rate=Fraction(25)):
    with filming(folder / "film", kind, pictures[0].shape[:2], rate) as film:
        for picture in pictures:
            film.show(picture, ticks)
    return film.path


@pytest.mark.parametrize("rate", [Fraction(1), Fraction(15), Fraction(600, 73), Fraction(24), Fraction(50)])
def test_both_films_show_the_pictures_and_are_as_long_as_their_ticks(tmp_path, rate):
    originals = [smooth(seed) for seed in range(6)]
    video, gif = (film_of(originals, tmp_path, kind, ticks=2, rate=rate) for kind in ("mp4", "gif"))
    assert sorted(tmp_path.iterdir()) == [gif, video] == [tmp_path / "film.gif", tmp_path / "film.mp4"]
    (frames, seen_rate), (pictures, durations) = decoded(video), unrolled(gif)
    assert (len(frames), seen_rate) == (12, rate)
    for film in (frames[::2], pictures):
        for picture, original in zip(film, originals, strict=True):
            assert picture.shape == (40, 60, 3)
            assert np.abs(picture.astype(float) - original).mean() < 6
    assert abs(sum(durations) - 12000 / rate) <= 5
    assert max(durations) - min(durations) <= 10
    assert min(durations) >= 20  # players slow down shorter frames


def test_pictures_that_stay_are_as_long_together_for_every_reader_take_no_room_and_do_not_flicker(tmp_path):
    av, stays = pytest.importorskip("av"), [400, 40, 40, 720, 40, 500]
    with filming(tmp_path / "film", "mp4", (40, 60), Fraction(1000), usual=Fraction(25)) as film:
        for seed, ticks in enumerate(stays):
            film.show(smooth(seed), ticks)
    with av.open(str(tmp_path / "film.mp4")) as container:
        assert container.duration == sum(stays) * 1000
        lengths = [packet.duration * packet.time_base for packet in container.demux(video=0) if packet.pts is not None]
    assert [round(1000 * length) for length in lengths] == stays
    still = smooth(0, 60, 60)
    moving = [still.copy() for _ in range(10)]
    for k, picture in enumerate(moving):
        picture[10:20, 5 * k : 5 * k + 5] = (250, 20, 90)
    alone = film_of([still], tmp_path, "gif").stat().st_size
    gif = film_of(moving, tmp_path, "gif")
    assert gif.stat().st_size < 2.5 * alone
    pictures, _ = unrolled(gif)
    assert len(pictures) == 10
    for picture in pictures[1:]:
        np.testing.assert_array_equal(picture[25:], pictures[0][25:])


def test_a_still_film_is_one_frame_slow_changes_are_not_lost_and_pictures_are_not_kept(tmp_path):
    gif = film_of([smooth(0)] * 30, tmp_path, "gif")
    pictures, durations = unrolled(gif)
    assert (len(pictures), sum(durations)) == (1, 1200)
    with Image.open(gif) as image:
        assert image.info["loop"] == 0, "it plays for ever"
    pictures = [np.full((4, 6, 3), level, np.uint8) for level in range(100)]
    gif = film_of(pictures, tmp_path, "gif")
    frames, durations = unrolled(gif)
    assert abs(int(frames[-1][0, 0, 0]) - 99) <= GIF_TOLERANCE
    assert sum(durations) == 4000
    references = []
    with filming(tmp_path / "film", "both", (40, 60), Fraction(25)) as film:
        for seed in range(20):
            picture = smooth(seed).copy()
            references.append(weakref.ref(picture))
            film.show(picture, 3)
            del picture
            assert sum(reference() is not None for reference in references) <= 1


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (5, 2), (33, 48), (32, 47)])
def test_a_video_of_odd_sides_repeats_its_edge(tmp_path, shape):
    video, gif = (film_of([smooth(0, *shape)] * 2, tmp_path, kind) for kind in ("mp4", "gif"))
    frames, _ = decoded(video)
    height, width = shape
    assert frames[0].shape == (height + height % 2, width + width % 2, 3)
    assert unrolled(gif)[0][0].shape == (*shape, 3)
    if height % 2 and height > 1:
        np.testing.assert_allclose(frames[-1][-1], frames[-1][-2], atol=12)


def test_a_large_gif_is_shrunk_and_a_film_that_is_broken_off_leaves_nothing(tmp_path):
    gif = film_of([smooth(seed, 300, 960) for seed in range(2)], tmp_path, "gif")
    pictures, _ = unrolled(gif)
    assert pictures[0].shape == (150, GIF_SIDE, 3)
    assert np.abs(pictures[1].astype(float) - smooth(1, 150, GIF_SIDE)).mean() < 6
    gif.unlink()

    def broken_off():
        with (
            filming(tmp_path / "film", "mp4", (8, 8), Fraction(25)) as film,
            filming(tmp_path / "film", "gif", (8, 8), Fraction(25)) as gif,
        ):
            film.show(smooth(0, 8, 8), 1)
            gif.show(smooth(0, 8, 8), 1)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        broken_off()
    assert not list(tmp_path.iterdir())


def test_without_av_or_its_encoder_every_film_is_a_gif_which_is_smaller(tmp_path, monkeypatch):
    monkeypatch.setattr(pytest.importorskip("av"), "codecs_available", {"mpeg4"})
    assert film_of([smooth(0)], tmp_path, "mp4") == tmp_path / "film.gif"
    monkeypatch.setitem(sys.modules, "av", None)
    for kind in ("mp4", "gif"):
        assert film_of([smooth(0)], tmp_path, kind) == tmp_path / "film.gif"
        assert largest_side(kind) == GIF_SIDE
    monkeypatch.undo()
    assert [largest_side(kind) for kind in ("mp4", "gif")] == [LARGEST_SIDE, GIF_SIDE]


COLORS = [(0.85, 0.15, 0.1), (0.1, 0.7, 0.25), (0.1, 0.25, 0.8), (0.95, 0.85, 0.3)]


def filled(steps=range(4), side: int = 64, size: tuple[int, int] = (48, 64), **options) -> Timelapse:
    timelapse = Timelapse(4, side, **options)
    for step in steps:
        timelapse.add(torch.tensor(COLORS[step])[:, None, None].expand(3, *size), step)
    return timelapse


def test_the_video_shows_the_frames_and_holds_the_last(tmp_path):
    path = filled().write(tmp_path)
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
    assert off.write(tmp_path) is Timelapse(5, 64).write(tmp_path) is None
    assert not list(tmp_path.iterdir())
    resumed = Timelapse(4, 80)
    torch.save(filled((0, 1, 2), side=80, size=shape).state_dict(), tmp_path / "state")
    resumed.load_state_dict(torch.load(tmp_path / "state", weights_only=True))
    resumed.add(torch.tensor(COLORS[3])[:, None, None].expand(3, *shape), 3)
    torch.testing.assert_close(resumed.state_dict(), filled(side=80, size=shape).state_dict())
    assert len(decoded(resumed.write(tmp_path))[0]) == len(COLORS) + round(HOLD_SECONDS * FPS)
    resumed.kind = "gif"
    assert len(unrolled(resumed.write(tmp_path))[0]) == len(COLORS)


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
        rate, ticks = choose_ticks(n_frames, seconds)
        assert MIN_FPS <= rate <= MOST_FPS
        assert rate == MOST_FPS or abs(ticks * n_frames / rate - seconds) < 1e-3 * seconds
    for impossible in (0.0, -seconds, 1.1, 301.0, float("nan")):
        words = "^timelapse_seconds=.* does not fit; choose 1.2 to 300 for 60 frames$"
        refuses(words, Timelapse, 60, 64, seconds=impossible)
    video, gif = (filled(side=16, size=(8, 12), seconds=seconds, kind=kind).write(tmp_path) for kind in ("mp4", "gif"))
    frames, rate = decoded(video)
    assert abs(len(frames) / rate - seconds - HOLD_SECONDS) < 0.1
    assert abs(sum(unrolled(gif)[1]) / 1000 - seconds - HOLD_SECONDS) < 0.1
    ticks = (len(frames) - round(HOLD_SECONDS * rate)) // len(COLORS)
    for k, color in enumerate(COLORS):  # each for the same time
        np.testing.assert_allclose(frames[k * ticks + ticks // 2].mean((0, 1)) / 255, color, atol=0.02)
