"""Test that brushwork analysis measures known strokes correctly, and that comparisons are well defined."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from brushexp_studies.analysis import summary
from brushexp_studies.analysis.summary import Analysis, analysis_of, comparison_of, overall_of, thinnest_of
from brushexp_studies.analysis.summary_text import brushwork_text
from refusals import refuses
from scenes import random_strokes, straight
from scipy.spatial.distance import cdist

from brushexp.plugins.blend.base import pixel_centres
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.results.stroke_table import (
    ALIGNED_WITHIN,
    DIRECTION_BINS,
    MEASURES,
    RADIUS_PITCHES,
    direction_shares,
    measure_strokes,
)
from brushexp.strokes.catalogue import Strokes
from brushexp.strokes.storage import Saved

SIZE = (60, 90)


def ranks(strokes: Strokes) -> torch.Tensor:
    return torch.arange(len(strokes), dtype=torch.int32)


def measured(strokes: Strokes, size: tuple[int, int] = SIZE, radius: float | None = None):
    return measure_strokes(strokes, ranks(strokes), size, radius)


def columns(table) -> dict[str, np.ndarray]:
    return {name: table[name] for name in table.dtype.names}


def saved(strokes: Strokes, size: tuple[int, int] = SIZE) -> Saved:
    return Saved(strokes, ranks(strokes), size, torch.ones(3), "analytic", "", 0, "seed: 0\n")


def painting(n: int = 60, seed: int = 0, size: tuple[int, int] = SIZE) -> Saved:
    made = random_strokes(n, size, seed=seed, width=(0.1, 0.3))
    return saved(replace(made, opacity=0.5 + 0.5 * made.opacity), size)


def analysis_of_random(n: int = 60, seed: int = 0, name: str = "one", size: tuple[int, int] = SIZE) -> Analysis:
    return analysis_of(painting(n, seed, size), name, f"{name}.h5")


def combed(n: int, angle: float = 0.5) -> Strokes:
    """Return ``n`` straight parallel strokes."""
    made = random_strokes(n, SIZE, width=(0.2, 0.2))
    way = torch.tensor([math.cos(angle), math.sin(angle)]).expand(n, 2)
    return replace(made, start=-0.5 * way, control=0 * way, end=0.5 * way, scale=torch.full((n,), 12.0))


@pytest.mark.parametrize(("end", "degrees"), [((50, 20), 0), ((40, 40), 45), ((10, 30), 135), ((15, 20), 0)])
def test_a_straight_stroke_has_its_length_and_direction(end, degrees):
    one, length = measured(straight((20, 20), end, width=3)), math.dist((20, 20), end)
    expected = {
        "length": length, "width": 3, "area": 3 * length + math.pi * 9 / 4, "elongatedness": length / 3,
        "straightness": 1, "curvature": 0, "orientation": math.radians(degrees),
        "x": (20 + end[0]) / 2, "y": (20 + end[1]) / 2,
    }  # fmt: skip
    for name, value in expected.items():
        assert one[name] == pytest.approx(value, rel=1e-5, abs=1e-5), name


def test_a_dot_has_no_direction_and_what_is_not_defined_is_nan():
    one = measured(Strokes.join(straight((20, 20), (20, 20), width=4), straight((22, 20), (30, 20))))
    assert (one.length[0], one.curvature[0]) == (0, 0)
    assert one.area[0] == pytest.approx(math.pi * 4)
    assert np.isnan([one.straightness[0], one.orientation[0]]).all()
    assert one.coherence[0] == pytest.approx(1)  # only one direction exists
    assert one.aligned.tolist() == [0, 0]
    assert one.neighbours.tolist() == [1, 1]
    assert np.isnan(measured(straight((10, 10), (30, 10), width=0)).elongatedness).all()
    alone = measured(straight((10, 10), (30, 10)))
    assert alone.neighbours == alone.aligned == 0
    assert np.isnan([alone.coherence, alone.deviation, alone.homogeneity]).all()
    assert all(len(values) == 0 for values in columns(measured(Strokes.none())).values())


def test_parallel_strokes_cohere_crossed_ones_do_not_and_neighbours_agree_with_the_obvious_loop():
    one = measured(combed(80))
    for name, value in {"coherence": 1, "deviation": 0, "aligned": 10, "homogeneity": 1}.items():
        assert one[name] == pytest.approx(value, abs=1e-3), name
    numbers = overall_of(analysis_of(saved(replace(combed(50), opacity=torch.ones(50))), "a", "a"))
    assert numbers["per_1000_px"] == pytest.approx(1000 * 50 / (60 * 90))
    assert [numbers[key] for key in ("agreement", "coherence", "entropy")] == pytest.approx([1, 1, 0])
    assert numbers["direction"] == pytest.approx(math.degrees(0.5), abs=1e-3)
    crossed = measured(Strokes.join(straight((20, 10), (40, 10)), straight((30, 5), (30, 25))), radius=20)
    assert crossed.coherence == pytest.approx(0, abs=1e-6)
    assert crossed.deviation == pytest.approx(math.sqrt(0.5))
    assert crossed.aligned.tolist() == [0, 0]
    made = random_strokes(70, SIZE)
    one = measured(made, radius=15)
    gaps = cdist(np.stack([one.x, one.y], 1), np.stack([one.x, one.y], 1))
    assert one.neighbours.tolist() == ((gaps <= 15).sum(1) - 1).tolist()
    for k, row in enumerate(gaps.argsort(1)[:, 1:11]):
        apart = np.abs((one.orientation[row] - one.orientation[k] + math.pi / 2) % math.pi - math.pi / 2)
        assert one.aligned[k] == (apart <= ALIGNED_WITHIN).sum()
    within = RADIUS_PITCHES * math.sqrt(60 * 90 / 70)
    assert measured(made).neighbours.tolist() == ((gaps <= within).sum(1) - 1).tolist()


def test_what_lies_above_hides_a_stroke_and_visible_shares_agree_with_the_obvious_sum():
    below, cover = straight((20, 30), (40, 30), width=6), straight((10, 30), (60, 30), width=20)
    assert measured(Strokes.join(below, cover)).visible == pytest.approx([0, 1], abs=2e-3)
    assert measured(straight((300, 300), (320, 300))).visible == 0
    ends = (4000, 4000), (9000, 4000)  # a huge canvas is analysed at a reduced size
    strokes = Strokes.join(straight(*ends, width=500), straight(*ends, width=900))
    assert measured(strokes, (8000, 12_000)).visible == pytest.approx([0, 1], abs=2e-3)
    strokes = random_strokes(15, SIZE, width=(0.1, 0.3))
    depth = torch.randperm(15)
    points = pixel_centres(torch.arange(60 * 90), 90, torch.float32)
    alpha, _ = Analytic()(strokes).sample(depth.argsort(descending=True)[None], points[None])
    light = torch.cumprod(torch.cat([torch.ones_like(alpha[:, :1]), 1 - alpha[:, :-1]], dim=1), dim=1)
    whole = alpha.sum(-1)[0]
    share = torch.where(whole > 1e-6, (alpha * light).sum(-1)[0] / whole, 0)
    visible = measure_strokes(strokes, depth, SIZE).visible
    np.testing.assert_allclose(visible[depth.argsort(descending=True)], share, atol=2e-3)


def test_statistics_of_many_of_one_and_of_nothing_and_directions_across_the_turn():
    values = np.arange(1.0, 6.0)
    assert summary.statistics_of(values) == {"n": 5, "mean": 3, "sd": math.sqrt(2.5), "q25": 2, "median": 3, "q75": 4}
    assert summary.statistics_of(np.array([3.0])) == {"n": 1, "mean": 3, "sd": None, "q25": 3, "median": 3, "q75": 3}
    for axial in (False, True):
        assert summary.statistics_of(np.array([]), axial)["mean"] is None
    numbers = summary.statistics_of(np.array([175.0, 5.0]), axial=True)
    assert min(numbers["mean"], 180 - numbers["mean"]) == pytest.approx(0, abs=1e-9)
    assert numbers["sd"] == pytest.approx(5, abs=0.01)
    assert numbers["median"] is None
    share = direction_shares(np.array([0.0, 4.9, 175.1, 90.0]))
    assert (share[0], share[DIRECTION_BINS // 2], share.sum()) == (0.75, 0.25, 1)
    assert summary.entropy_of(np.full(50, 1.0)) == 0
    assert summary.entropy_of(np.arange(0.0, 1260, 10) % 180) == pytest.approx(1)


def test_faint_and_thin_strokes_are_left_out_and_hidden_ones_if_asked():
    source = painting(40)
    opacity, width = source.strokes.opacity.clone(), source.strokes.width.clone()
    opacity[3], width[7] = 0.05, 1e-5
    one = analysis_of(replace(source, strokes=replace(source.strokes, opacity=opacity, width=width)), "a", "a")
    assert (one.total, len(one.number)) == (40, 38)
    assert set(range(40)) - set(one.number.tolist()) == {3, 7}
    assert sorted(one.depth.tolist()) == list(range(38))
    strokes = Strokes.join(straight((20, 30), (40, 30), width=6), straight((10, 30), (60, 30), width=20))
    one = analysis_of(saved(strokes), "a", "a", visible=0.5)
    assert (one.number.tolist(), one.measures.neighbours.tolist()) == ([1], [0])


@pytest.mark.parametrize("strokes", [Strokes.none(), straight((10, 10), (20, 20), opacity=0.01)])
def test_a_painting_of_nothing_is_refused(strokes):
    words = r"against=x.h5: none of its \d strokes is visible"
    refuses(words, analysis_of, saved(strokes), "x", "x.h5", option="against")


@pytest.mark.parametrize("size", [(600, 900), (60, 90)])
def test_a_thin_stroke_counts_even_if_it_is_the_only_one(size):
    zoom = size[1] / 900
    one = analysis_of(saved(straight((100, 300), (400, 300), width=3).moved(zoom=zoom), size), "a", "a")
    assert one.number.tolist() == [0]
    assert thinnest_of(1, size) == pytest.approx(0.02 * math.sqrt(size[0] * size[1] / 400))
    assert "thinner than" in brushwork_text([one])


@pytest.mark.parametrize("zoom", [1, 2])
def test_a_painting_beside_itself_is_no_different_at_any_size_and_a_turned_one_by_its_angle(zoom):
    source = painting()
    large = replace(source, strokes=source.strokes.moved(zoom=zoom), size=(60 * zoom, 90 * zoom))
    far = comparison_of(analysis_of(source, "a", "a"), analysis_of(large, "b", "b"))
    for name in MEASURES if zoom == 1 else ("length", "width", "area", "curvature", "orientation", "coherence"):
        assert far[name]["distance"] == pytest.approx(0, abs=1e-4), name
        assert far[name]["difference"] == pytest.approx(0, abs=1e-4), name
        assert far[name]["delta"] in (None, pytest.approx(0, abs=0.05))
        assert far[name]["effect"] in ("negligible", None)
    one, other = (analysis_of(saved(combed(40, angle)), "a", "a") for angle in (0.1, -0.1))
    turned = comparison_of(one, other)["orientation"]
    assert [turned[key] for key in ("difference", "distance")] == pytest.approx([math.degrees(0.2)] * 2, abs=0.01)
    assert turned["delta"] is None


@pytest.mark.parametrize(("n", "m"), [(1, 1), (1, 9), (17, 40)])
def test_cliffs_delta_counts_pairs(n, m):
    source = np.random.default_rng(n + m)
    a, b = source.normal(size=n).round(1), source.normal(0.5, size=m).round(1)
    assert summary.compare(a, b, axial=False)["delta"] == pytest.approx(np.sign(a[:, None] - b[None]).mean())


@pytest.mark.parametrize("n", [1, 8, 25])
def test_on_a_circle_the_best_cut_is_taken(n):
    source = np.random.default_rng(n)
    a, b = source.uniform(0, 180, n), source.uniform(0, 180, n)
    pairings = [np.abs((np.sort(a) - np.roll(np.sort(b), k) + 90) % 180 - 90).mean() for k in range(n)]
    assert summary.circular_distance(a, b) == pytest.approx(min(pairings))


def test_effects_are_cohens_and_have_words():
    samples_of = [([1, 2, 3], [3, 4, 5], -2), ([1], [2], None), ([1, 1, 1], [1, 1, 1], None)]
    for a, b, expected in samples_of:
        assert summary.compare(np.array(a, float), np.array(b, float), axial=False)["standardised"] == expected
    for larger, word in {0: "negligible", 2: "negligible", 4: "small", 8: "medium", 10: "large", 20: "large"}.items():
        a = np.repeat([1.0, 0.0], [larger, 20 - larger])
        assert summary.compare(a, np.zeros(20), axial=False)["effect"] == word
