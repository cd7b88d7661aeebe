"""Test that the film shows strokes being painted, ends with the finished painting, and has the requested duration."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch
from brushexp_exports.process import Process, schedule, shrink_to_side, states
from brushexp_policies.topk import TopK
from catalogues import changed
from catalogues import job_of as of_catalogue
from films import decoded, unrolled
from scenes import Windowed, random_strokes, with_shapes

from brushexp.plugins.blend.dense import Dense
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.export.base import ExportJob
from brushexp.registry import build_named
from brushexp.shading.light import Light
from brushexp.strokes.bezier import curve_of, drift_of, half_width_of, point_at, truncate
from brushexp.strokes.catalogue import Strokes
from brushexp.system.files import to_bytes


def painted(n: int = 40, size: tuple[int, int] = (36, 52), renderer=None, blend=None) -> ExportJob:
    background = torch.tensor([0.9, 0.5, 0.2])
    canvas = {"depth": torch.randperm(n), "background": background, "renderer": renderer, "blend": blend}
    return of_catalogue(random_strokes(n, size), size, **canvas)


def painted_at_once(job: ExportJob, share: np.ndarray) -> torch.Tensor:
    """Draw each stroke up to its fraction in ``share``, bottom to top, in a single pass."""
    n = int((share > 0).sum())
    with torch.no_grad():
        layers = job.renderer(truncate(job.strokes[job.bottom_up[:n]], torch.from_numpy(share[:n]).float()))
        return job.blend(layers, torch.arange(n).flip(0), job.size, job.saved.background).image


def whole(job: ExportJob, counts: list[int]) -> list[np.ndarray]:
    """Return, for each count, the fractions to draw if the first ``count`` strokes are complete and others absent."""
    return [(np.arange(len(job.strokes)) < count).astype(float) for count in counts]


def test_in_the_light_and_in_another_colour_space_every_state_is_the_painting_of_its_strokes_in_bands_too(monkeypatch):
    job = replace(painted(renderer=build_named("renderer", "textured", {}).eval()), light=Light(depth=2.0))
    bare, half, last = (to_bytes(state) for state in states(job, whole(job, [0, 17, 40])))
    assert np.abs(last.astype(int) - job.picture()).max() <= 1
    assert np.abs(last.astype(int) - replace(job, light=Light()).picture()).max() > 8
    assert (bare == bare[0, 0]).all()
    assert np.abs(half.astype(int) - last).max() > 8
    job = replace(painted(), space=build_named("color", "pigment", {}))
    *_, last = states(job, whole(job, [0, 40]))
    torch.testing.assert_close(last, torch.cat([band for _, band in job.bands()], dim=1), atol=2e-3, rtol=0)
    job = painted(50, (200, 40), renderer=Windowed())
    unbanded = [picture.clone() for picture in states(job, whole(job, [10, 50]))]
    monkeypatch.setattr("brushexp.compositing.bands.BAND", 40 * 64)
    for picture, expected in zip(states(job, whole(job, [10, 50])), unbanded, strict=True):
        torch.testing.assert_close(picture, expected, rtol=0, atol=1e-5)


@pytest.mark.parametrize(("renderer", "blend"), [
    ("analytic", Tiled()), ("textured", Tiled()), ("neural", Tiled()),
    ("analytic", Tiled(kernel="torch")), ("analytic", Dense()), ("analytic", TopK(k=5)),
])  # fmt: skip
def test_each_state_is_the_painting_of_its_strokes_and_a_slow_blend_says_so(renderer, blend, caplog):
    job = painted(renderer=build_named("renderer", renderer, {}).eval(), blend=blend)
    shares = whole(job, [0, 1, 7, 7, 25, 40])
    for share, picture in zip(shares, states(job, shares), strict=True):
        torch.testing.assert_close(picture, painted_at_once(job, share), rtol=0, atol=2e-4)
    assert ("try blend=tiled" in caplog.text) == isinstance(blend, TopK)


def seen_at(strokes: Strokes, t: torch.Tensor) -> torch.Tensor:
    """Compute each stroke's position, thickness and colour at curve parameters ``t``."""
    u = 2 * t[:, None] - 1
    thickness = half_width_of(strokes)[:, None] * (1 + strokes.widening[:, None] * u)
    return torch.cat([point_at(curve_of(strokes), t), thickness, strokes.color + drift_of(strokes) * u], 1)


def test_a_growing_stroke_is_a_part_of_it():
    strokes = with_shapes(random_strokes(5, (30, 40)))
    share = torch.tensor([1e-6, 0.3, 0.5, 0.9, 1.0])
    for point in torch.linspace(0, 1, 9)[:, None]:
        part = seen_at(truncate(strokes, share), point.expand(5))
        torch.testing.assert_close(part, seen_at(strokes, point * share))
    assert torch.equal(truncate(strokes, share).end[-1], strokes.end[-1])


def test_growing_strokes_have_no_more_than_their_renderer_draws():
    plain = painted(20, renderer=build_named("renderer", "textured", {}).eval())
    shaped = replace(plain, saved=replace(plain.saved, strokes=with_shapes(plain.strokes)))
    shares = [np.linspace(1.5, 0, 20).clip(0, 1)]
    assert torch.equal(*(next(states(job, shares)) for job in (plain, shaped)))


@pytest.mark.parametrize("blend", [Tiled(), TopK(k=5)])
def test_strokes_that_grow_lie_on_those_that_are_finished(blend):
    job = painted(20, blend=blend)
    share = np.concatenate([np.ones(15), [0.8, 0.5, 0.2], np.zeros(2)])
    shares = [np.zeros(20), share, np.ones(20)]
    for part, picture in zip(shares, states(job, shares), strict=True):
        torch.testing.assert_close(picture, painted_at_once(job, part), rtol=0, atol=2e-4)


@pytest.mark.parametrize("growing", [True, False])
@pytest.mark.parametrize("pace", ["even", "quickening"])
@pytest.mark.parametrize(("n", "frames"), [(0, 5), (1, 5), (1, 1), (7, 250), (5, 2)])
def test_the_canvas_is_bare_first_and_finished_last(n, frames, pace, growing):
    shares = list(schedule(n, frames, 3.0, pace, growing=growing))
    assert len(shares) == frames
    assert (shares[-1] == 1).all()
    assert frames == 1 or (shares[0] == 0).all()
    for before, after in pairwise(shares):
        assert (after >= before).all()
    for share in shares:
        assert share.shape == (n,)
        assert (np.diff(share) <= 0).all()
        assert growing or np.isin(share, [0, 1]).all()


def test_quickening_begins_slowly_and_long_canvases_are_drawn_at_the_size_of_the_film(tmp_path):
    even, quickening = (
        [share.sum() for share in schedule(1000, 101, 100.0, pace, growing=True)] for pace in ("even", "quickening")
    )
    np.testing.assert_allclose(np.diff(even[1:-1]), 10, atol=0.1)
    assert abs(quickening[10] - 10) < 1
    assert np.diff(quickening)[-2] > 18
    job = painted(20, (60, 1200))
    assert shrink_to_side(job, 4096) is job
    small = shrink_to_side(job, 480)
    assert small.size == (24, 480)
    (gif,) = Process(seconds=0.5, hold=0.0, format="gif").write(job, tmp_path)
    assert np.abs(unrolled(gif)[0][-1].astype(float) - small.picture()).mean() < 3


@pytest.mark.parametrize(("seconds", "fps", "hold"), [(1.0, 25, 0.2), (2.0, 10, 0.0), (0.5, 50, 0.3), (0.1, 1, 2.0)])
@pytest.mark.parametrize(("n", "size"), [(0, (36, 52)), (30, (33, 51)), (30, (1, 1)), (30, (1, 40))])
def test_films_begin_with_the_canvas_end_with_the_painting_and_are_as_long_as_was_asked(
    tmp_path, n, size, seconds, fps, hold
):
    job = painted(n, size)
    job = changed(job, strokes=replace(job.strokes, opacity=torch.ones(n)))
    count = max(1, round(seconds * fps)) + round(hold * fps)
    films = (Process(seconds=seconds, fps=fps, hold=hold, format=kind) for kind in ("mp4", "gif"))
    (video,), (gif,) = (film.write(job, tmp_path) for film in films)
    assert sorted(tmp_path.iterdir()) == [gif, video] == [tmp_path / "process.gif", tmp_path / "process.mp4"]
    (frames, rate), (pictures, durations) = decoded(video), unrolled(gif)
    assert (len(frames), rate) == (count, fps)
    assert abs(sum(durations) - 1000 * count / fps) <= 5
    height, width = size
    for film, rough in ((frames, 12), (pictures, 3)):  # videos subsample colours
        assert max(film[0].shape[0] - height, film[0].shape[1] - width) <= 1
        first, last = (film[k][:height, :width].astype(float) for k in (0, -1))
        assert round(seconds * fps) < 2 or np.abs(first / 255 - job.saved.background.numpy()).max() < 0.03
        assert np.abs(last - job.picture()).mean() < rough


@pytest.mark.parametrize(("growing", "most"), [(None, 1), (False, 1), (True, 8)])
def test_a_slow_renderer_draws_each_stroke_once_unless_they_grow(tmp_path, growing, most):
    brush = Windowed()
    assert brush.warm_up is not None
    job = changed(painted(10, renderer=brush), strokes=random_strokes(200, (36, 52)), depth=torch.randperm(200).int())
    Process(seconds=2.0, hold=0.0, growing=growing).write(job, tmp_path)
    assert (most - 1) * 200 / 2 < brush.drawn <= 2 * most * 200, (
        "each stroke is drawn once for its paint and once for the light it lets through"
    )
