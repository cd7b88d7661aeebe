"""Strokes are found again: maps turned back, scales chosen, tiles joined, curves and order fitted, results stored."""

from functools import partial
from itertools import combinations

import numpy as np
import pytest
import torch
from brushexp_recovery import finding, refining
from brushexp_recovery.curves import Fitted, fit_curve
from brushexp_recovery.finding import find_regions
from brushexp_recovery.maps import predict
from brushexp_recovery.model import RecoveryModel
from brushexp_recovery.network import AFFINE, CENTRE, CHANNELS, GEOMETRY, OFFSETS, OVER, TURN, UNIT
from brushexp_recovery.raster.tiles import split_into_tiles
from brushexp_recovery.recover import recover, recover_with
from brushexp_recovery.refining import refine
from brushexp_recovery.regions import pieces_of
from brushexp_recovery.stacking import stack
from brushexp_recovery.storage import Recovered, read_recovered, write_recovered
from brushexp_recovery.synthesis import Hand, Laid, lay_strokes
from brushexp_recovery.synthesis_canvas import Mixing, compose, geometry_of
from brushexp_recovery.synthesis_looks import Look, draw_strokes
from brushexp_recovery.synthesis_paintings import Painted
from brushexp_recovery.training import losses_of

from brushexp.errors import UserError
from brushexp.strokes.storage import load_catalogue, save_catalogue

ROUGH = np.array([[[25.0, 40.0], [60, 50], [95, 60]], [[70, 20], [60, 45], [50, 75]]])  # curves near those of `bars`


def silent(share: float, state: str) -> None:
    """Show nothing."""


def bars(angle: float = 0.4) -> Painted:
    """Two straight strokes of 20 px on 96 x 128 px, the second over the first, drawn with discs."""
    way = 35 * np.array([np.cos(angle), np.sin(angle)])
    middle = np.array([[60.0, 48.0], [60.0, 48.0]])
    ways = np.array([way, [-way[1], way[0]]])
    curve = np.stack([middle - ways, middle, middle + ways], 1)
    laid = Laid(curve, np.full(2, 20.0), np.array([[0.9, 0.1, 0.1], [0.1, 0.2, 0.9]]), np.zeros(2), np.zeros(2))
    drawn = draw_strokes(laid, Look("engine", "disc", {}, 1.0), 0)
    composed = compose(drawn, laid, Mixing(1.0, np.ones(2), np.zeros(2)), np.full((96, 128, 3), 0.5))
    image = (composed.image * 255).round().astype(np.uint8)
    return Painted(image, composed.labels.astype(np.int16), geometry_of(drawn, composed))


class Oracle(torch.nn.Module):
    """Says what is true of a picture whose red channel is the number of the stroke / 10, in its own frame."""

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        labels = (x[0, 0] * 10).round().long()
        out = torch.zeros(1, CHANNELS, *labels.shape)
        for first, offsets in ((0, OFFSETS), (AFFINE + GEOMETRY, OVER)):
            for k, (dy, dx) in enumerate(offsets):
                there = torch.roll(labels, (-dy, -dx), (0, 1))
                sign = (there == labels) if first == 0 else (there > labels).int() - (there < labels).int()
                out[0, first + k] = 20.0 * (2 * sign - 1) if first == 0 else sign.float()
        rows, columns = torch.meshgrid(*(torch.arange(n) + 0.5 for n in labels.shape), indexing="ij")
        for number in labels.unique():
            own = labels == number
            place = torch.stack([columns[own], rows[own]])
            offset = (place.mean(1)[:, None] - place) / UNIT
            out[0, AFFINE : AFFINE + GEOMETRY][CENTRE][:, own] = offset
            xx, yy, xy = (c.item() for c in (place[0].var(), place[1].var(), torch.cov(place)[0, 1]))
            out[0, AFFINE : AFFINE + GEOMETRY][TURN][:, own] = torch.tensor([[xx - yy], [2 * xy]])
        return out


def test_maps_of_turned_copies_say_the_same():
    labels = torch.zeros(64, 96)
    labels[10:50, 10:30], labels[20:40, 25:80], labels[45:60, 50:58] = 3, 5, 2
    image = np.stack([labels.numpy() / 10] * 3, 2).astype(np.float32)
    one, eight = predict(Oracle(), image, 1), predict(Oracle(), image, 8)
    inner = np.s_[:, 20:-20, 20:-20]  # at borders the oracle looks round the corner
    for name in ("affinity", "geometry", "over"):
        np.testing.assert_allclose(getattr(eight, name)[inner], getattr(one, name)[inner], rtol=1e-3, atol=1e-3)


def test_losses_have_the_gradients_of_their_values():
    labels = torch.tensor([[[0, 0, 1, 1], [0, -1, 1, 2], [2, 2, 2, 2], [0, 0, 2, 1]]]).repeat(2, 6, 6)
    geometry, told = torch.randn(2, 7, 24, 24).double(), torch.randn(2, CHANNELS, 24, 24).double()
    way = torch.randn_like(told)
    loss = lambda t: sum(losses_of(told + t * way, labels, geometry.sigmoid()).values())  # noqa: E731
    t = torch.zeros((), dtype=torch.float64, requires_grad=True)
    (slope,) = torch.autograd.grad(loss(t), t)
    torch.testing.assert_close(slope, (loss(t + 1e-6) - loss(t - 1e-6)) / 2e-6, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("size", [(1, 1), (300, 200), (5000, 3), (1900, 2500)])
@pytest.mark.parametrize("zoom", [0.3, 1.0, 2.2])
def test_every_pixel_is_in_the_core_of_one_tile(size, zoom):
    seen = np.zeros(size, int)
    for (top, bottom, left, right), (first, last, begin, end) in split_into_tiles(*size, zoom, 576):
        assert top <= first < last <= bottom
        assert left <= begin < end <= right
        seen[first:last, begin:end] += 1
    assert (seen == 1).all()


@pytest.mark.parametrize(
    ("worth", "zoom"), [((0.50, 0.52, 0.4), 2.25), ((0.50, 0.53, 0.4), 1.5), ((0.1, 0.2, 0.3), 1.0)]
)
def test_a_scale_that_explains_clearly_more_is_taken_instead_of_the_guessed_one(monkeypatch, worth, zoom):
    shares = dict(zip((2.25, 1.5, 1.0), worth, strict=True))
    monkeypatch.setattr(finding, "guess_zoom", lambda *_: 2.25)
    monkeypatch.setattr(finding, "explained", lambda model, judges, parts, zoom: shares[round(zoom, 6)])
    assert finding.find_zoom(None, None, np.zeros((300, 400, 3), np.float32)) == pytest.approx(zoom)


def test_a_part_is_explained_by_the_regions_that_were_painted(scene):
    model = shipped()
    judges, image = (model.pairs.asked(), model.nodes.asked()), scene.image.astype(np.float32) / 255
    noise = np.random.default_rng(0).random((64, 64, 3)).astype(np.float32)
    assert finding.explained(model, judges, [image], 1.0) > 0.4
    assert finding.explained(model, judges, [noise], 1.0) < 0.2
    assert finding.explained(model, judges, [image], 1.0) <= 1


def test_strokes_are_stacked_as_the_evidence_says():
    random = np.random.default_rng(0)
    order = random.permutation(30)
    pairs = np.array([pair for pair in combinations(range(30), 2) if random.random() < 0.3])
    rank = order.argsort()
    evidence = np.sign(rank[pairs[:, 1]] - rank[pairs[:, 0]]) * random.random(len(pairs))
    found = stack(30, pairs, evidence).argsort()
    assert sorted(found) == list(range(30))
    assert ((found[pairs[:, 1]] > found[pairs[:, 0]]) == (evidence > 0)).all()


def test_a_straight_region_becomes_its_stroke():
    rows, columns = np.mgrid[:60, :80] + 0.5
    along, across = (columns - 40) * 0.8 + (rows - 30) * 0.6, (rows - 30) * 0.8 - (columns - 40) * 0.6
    inside = (np.abs(along) < 25) & (np.abs(across) < 5)
    points = np.stack([columns[inside], rows[inside]], 1)
    angle = 2 * np.arctan2(0.6, 0.8)
    curve, width = fit_curve(points, np.array([40, 30, np.cos(angle), np.sin(angle), np.log(10), np.log(50), 1.0]))
    assert width == pytest.approx(10, rel=0.1)
    chord = curve[2] - curve[0]
    assert abs(np.arctan2(chord[1], chord[0])) == pytest.approx(angle / 2, abs=0.02)
    np.testing.assert_allclose(curve.mean(0), [40, 30], atol=0.5)
    assert np.linalg.norm(chord) + width == pytest.approx(50, rel=0.1)


def test_refining_moves_strokes_onto_their_regions():
    painted = bars()
    labels = painted.labels.astype(np.int32)
    rough = Fitted(ROUGH, np.array([12.0, 28.0]), np.zeros((2, 3)))
    before, after = (seen(fitted, labels) for fitted in (rough, refine(rough, labels, np.arange(2), show=silent)))
    assert after > before + 0.1
    assert after > 0.9


def seen(fitted: Fitted, labels: np.ndarray) -> float:
    """Mean IoU of what is seen of two strokes with their regions."""
    from brushexp_recovery.outlines import covers_of, seen_of  # noqa: PLC0415

    drawn, _ = seen_of(covers_of(fitted.curve, fitted.width, labels.shape), np.ones(2), labels.shape)
    return float(np.mean([((drawn == k) & (labels == k)).sum() / ((drawn == k) | (labels == k)).sum() for k in (0, 1)]))


@pytest.mark.parametrize("size", [(1, 1), (1200, 3), (40, 56)])
@pytest.mark.parametrize("kind", ["one colour", "grey noise"])
def test_any_picture_can_be_looked_at(size, kind):
    image = np.full((*size, 3), 0.3, np.float32)
    if kind == "grey noise":
        image[:] = np.random.default_rng(0).random((*size, 1))
    recovered = recover_with(shipped(), image, 1.0, 1, silent)
    assert recovered.labels.shape == size
    assert len(recovered.confidence) == len(recovered.saved.strokes)
    recovered.saved.check()


def shipped() -> RecoveryModel:
    """Weights that come with the program."""
    from brushexp_recovery.model import load_model  # noqa: PLC0415

    return load_model()


@pytest.fixture(scope="module")
def scene() -> Painted:
    """Some 50 strokes of bristles on 176 x 208 px."""
    random = np.random.default_rng(5)
    rows, columns = np.mgrid[:176, :208] / 200
    picture = np.stack([0.5 + 0.4 * np.sin(4 * rows + 3 * columns + k) for k in range(3)], 2).astype(np.float32)
    laid = lay_strokes(picture, 50, Hand(), random)
    drawn = draw_strokes(laid, Look("renderer", "textured", {}), 0)
    composed = compose(drawn, laid, Mixing(4.0, np.ones(50), np.zeros(50)), np.full((176, 208, 3), 0.6))
    image = (composed.image * 255).round().astype(np.uint8)
    return Painted(image, composed.labels.astype(np.int16), geometry_of(drawn, composed))


def found(labels: np.ndarray, truth: np.ndarray) -> float:
    """Compute F1 at an IoU of 0.5 of the regions of two pictures."""
    counts = [np.bincount(one[one >= 0]) for one in (labels, truth)]
    both = (labels >= 0) & (truth >= 0)
    pairs, number = np.unique(np.stack([labels[both], truth[both]]), axis=1, return_counts=True)
    hits = (number / (counts[0][pairs[0]] + counts[1][pairs[1]] - number) >= 0.5).sum()
    return float(2 * hits / sum((one >= 12).sum() for one in counts))


def test_most_strokes_of_a_small_painting_are_found_again(scene):
    recovered = recover(scene.image, copies=1)
    assert found(recovered.labels, scene.labels.astype(int)) > 0.5


def test_tiles_find_what_the_whole_picture_shows(monkeypatch, scene):
    image = scene.image.astype(np.float32) / 255
    whole = find_regions(shipped(), image, 0.8, 1, silent).labels
    monkeypatch.setattr(finding, "TILE", 128)
    monkeypatch.setattr(finding, "split_into_tiles", partial(split_into_tiles, margin=32))
    assert len(list(split_into_tiles(*image.shape[:2], 0.8, 128, 32))) > 1
    assert found(find_regions(shipped(), image, 0.8, 1, silent).labels, whole) > 0.7


def test_a_large_picture_is_refined_as_a_small_one(monkeypatch):
    labels = np.tile(bars().labels.astype(np.int32), (1, 3))
    labels[labels >= 0] += 2 * (np.arange(384) // 128)[None].repeat(96, 0)[labels >= 0]
    curve = np.concatenate([ROUGH + np.array([128.0 * k, 0]) for k in range(3)])
    rough = Fitted(curve, np.tile([12.0, 28.0], 3), np.zeros((6, 3)))
    whole = refine(rough, labels, np.arange(6), show=silent)
    monkeypatch.setattr(refining, "SIDE", 200)
    tiled = refine(rough, labels, np.arange(6), show=silent)
    np.testing.assert_allclose(tiled.width, whole.width, rtol=0.1)
    np.testing.assert_allclose(tiled.curve, whole.curve, atol=5)


def test_pieces_sum_up_to_the_picture():
    painted = bars()
    image = painted.image.astype(np.float32) / 255
    pieces = pieces_of(predict(RecoveryModel().eval().network, image, 1), image)
    assert pieces.sums[:, 0].sum() == 96 * 128
    assert pieces.within[:, 4:].sum() + pieces.between[:, 4:].sum() == pytest.approx(
        sum((96 - dy) * (128 - abs(dx)) for dy, dx in OFFSETS)
    )


def test_what_was_recovered_is_read_as_it_was_written(tmp_path):
    for n in (0, 5):
        random = np.random.default_rng(n)
        recovered = some_strokes(n, random)
        write_recovered(tmp_path / "catalogue.h5", recovered)
        again = read_recovered(tmp_path / "catalogue.h5")
        np.testing.assert_array_equal(again.labels, recovered.labels)
        np.testing.assert_array_equal(again.confidence, recovered.confidence)
        torch.testing.assert_close(
            load_catalogue(tmp_path / "catalogue.h5").strokes.color, recovered.saved.strokes.color
        )


def some_strokes(n: int, random: np.random.Generator) -> Recovered:
    """Strokes that nobody has painted."""
    from brushexp_recovery.recover import in_order  # noqa: PLC0415

    labels = random.integers(-1, n, (20, 30)).astype(np.int32)
    fitted = Fitted(random.random((n, 3, 2)) * 30, random.random(n) * 5 + 1, random.random((n, 3)))
    image = random.random((20, 30, 3)).astype(np.float32)
    return in_order(labels, fitted, random.random(n), random.permutation(n), image)


def test_a_painted_catalogue_is_not_one_that_was_recovered(tmp_path):
    save_catalogue(tmp_path / "catalogue.h5", some_strokes(3, np.random.default_rng(0)).saved)
    with pytest.raises(UserError, match=r"give the catalogue.h5 of task=recover"):
        read_recovered(tmp_path / "catalogue.h5")
