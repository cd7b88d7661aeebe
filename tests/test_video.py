"""Films are as long and as large as was asked, look like their pictures, and are written without being collected."""

import sys
import weakref
from fractions import Fraction

import numpy as np
import pytest
from films import decoded, unrolled
from PIL import Image

from brushexp.pictures.video import GIF_SIDE, LARGEST_SIDE, SAME, filming, largest_side


def smooth(seed: int, height: int = 40, width: int = 60) -> np.ndarray:
    """A picture of large soft patches."""
    few = np.random.default_rng(seed).integers(0, 256, (3, 4, 3), np.uint8)
    return np.asarray(Image.fromarray(few).resize((width, height), Image.Resampling.BICUBIC))


def film_of(pictures, folder, kind, ticks=1, rate=Fraction(25)):
    with filming(folder / "film", kind, pictures[0].shape[:2], rate) as film:
        for picture in pictures:
            film.show(picture, ticks)
    return film.paths


@pytest.mark.parametrize("rate", [Fraction(1), Fraction(15), Fraction(600, 73), Fraction(24), Fraction(50)])
def test_both_films_show_the_pictures_and_are_as_long_as_their_ticks(tmp_path, rate):
    originals = [smooth(seed) for seed in range(6)]
    video, gif = film_of(originals, tmp_path, "both", ticks=2, rate=rate)
    assert sorted(tmp_path.iterdir()) == [gif, video] == [tmp_path / "film.gif", tmp_path / "film.mp4"]
    (frames, seen_rate), (pictures, durations) = decoded(video), unrolled(gif)
    assert (len(frames), seen_rate) == (12, rate)
    for film in (frames[::2], pictures):
        for picture, original in zip(film, originals, strict=True):
            assert picture.shape == (40, 60, 3)
            assert np.abs(picture.astype(float) - original).mean() < 6
    assert abs(sum(durations) - 12000 / rate) <= 5
    assert max(durations) - min(durations) <= 10
    assert min(durations) >= 20  # below that players take their time


def test_what_stays_the_same_takes_no_room_and_does_not_flicker(tmp_path):
    still = smooth(0, 60, 60)
    moving = [still.copy() for _ in range(10)]
    for k, picture in enumerate(moving):
        picture[10:20, 5 * k : 5 * k + 5] = (250, 20, 90)
    alone = film_of([still], tmp_path, "gif")[0].stat().st_size
    (gif,) = film_of(moving, tmp_path, "gif")
    assert gif.stat().st_size < 2.5 * alone
    pictures, _ = unrolled(gif)
    assert len(pictures) == 10
    for picture in pictures[1:]:
        np.testing.assert_array_equal(picture[25:], pictures[0][25:])


def test_a_still_film_is_one_frame_of_its_whole_length_and_slow_changes_are_not_lost(tmp_path):
    (gif,) = film_of([smooth(0)] * 30, tmp_path, "gif")
    pictures, durations = unrolled(gif)
    assert (len(pictures), sum(durations)) == (1, 1200)
    with Image.open(gif) as image:
        assert image.info["loop"] == 0, "it plays for ever"
    pictures = [np.full((4, 6, 3), level, np.uint8) for level in range(100)]
    (gif,) = film_of(pictures, tmp_path, "gif")
    frames, durations = unrolled(gif)
    assert abs(int(frames[-1][0, 0, 0]) - 99) <= SAME
    assert sum(durations) == 4000


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (5, 2), (33, 48), (32, 47)])
def test_a_video_of_odd_sides_repeats_its_edge(tmp_path, shape):
    video, gif = film_of([smooth(0, *shape)] * 2, tmp_path, "both")
    frames, _ = decoded(video)
    height, width = shape
    assert frames[0].shape == (height + height % 2, width + width % 2, 3)
    assert unrolled(gif)[0][0].shape == (*shape, 3)
    if height % 2 and height > 1:
        np.testing.assert_allclose(frames[-1][-1], frames[-1][-2], atol=12)


def test_a_large_gif_is_shrunk_and_a_film_that_is_broken_off_leaves_nothing(tmp_path):
    (gif,) = film_of([smooth(seed, 300, 960) for seed in range(2)], tmp_path, "gif")
    pictures, _ = unrolled(gif)
    assert pictures[0].shape == (150, GIF_SIDE, 3)
    assert np.abs(pictures[1].astype(float) - smooth(1, 150, GIF_SIDE)).mean() < 6
    gif.unlink()

    def broken_off():
        with filming(tmp_path / "film", "both", (8, 8), Fraction(25)) as film:
            film.show(smooth(0, 8, 8), 1)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        broken_off()
    assert not list(tmp_path.iterdir())


def test_pictures_are_not_kept(tmp_path):
    references = []
    with filming(tmp_path / "film", "both", (40, 60), Fraction(25)) as film:
        for seed in range(20):
            picture = smooth(seed).copy()
            references.append(weakref.ref(picture))
            film.show(picture, 3)
            del picture
            assert sum(reference() is not None for reference in references) <= 1


def test_without_av_or_its_encoder_every_film_is_a_gif_which_is_smaller(tmp_path, monkeypatch):
    monkeypatch.setattr(pytest.importorskip("av"), "codecs_available", {"mpeg4"})
    assert film_of([smooth(0)], tmp_path, "mp4") == [tmp_path / "film.gif"]
    monkeypatch.setitem(sys.modules, "av", None)
    for kind in ("mp4", "gif", "both"):
        assert film_of([smooth(0)], tmp_path, kind) == [tmp_path / "film.gif"]
        assert largest_side(kind) == GIF_SIDE
    monkeypatch.undo()
    assert [largest_side(kind) for kind in ("mp4", "gif", "both")] == [LARGEST_SIDE, GIF_SIDE, LARGEST_SIDE]
