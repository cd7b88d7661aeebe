"""Test that trained networks place exactly the requested number of strokes, with the quality measured at release."""

import math
from itertools import pairwise

import pytest
import torch
from brushexp_predictor.lay.colors import best_colors
from brushexp_predictor.lay.decoding import FORMS, draw, strokes_of
from brushexp_predictor.lay.network import CELL, NUMBERS, RECEPTIVE_FIELD, StrokePredictor, load_predictor
from brushexp_predictor.lay.predicting import TILE_CELLS, in_tiles, predict
from brushexp_predictor.lay.pyramid import levels_of
from brushexp_predictor.predicted import Predicted
from torch import Tensor

import brushexp
from brushexp.pictures.load import load_picture
from brushexp.strokes.bezier import curve_of
from brushexp.strokes.catalogue import Strokes, check_strokes


def psnr(picture: Tensor, target: Tensor) -> float:
    return -10 * math.log10(float((picture.clamp(0, 1) - target).square().mean()))


def drawn(strokes: Strokes, target: Tensor) -> Tensor:
    return draw(FORMS["plain"], strokes, (target.shape[1], target.shape[2]), target.mean((1, 2)))


@pytest.mark.parametrize(("size", "n"), [
    ((1, 1), 1), ((3, 2), 6), ((1, 300), 300), ((40, 56), 1), ((40, 56), 2), ((56, 40), 333), ((90, 9), 17),
])  # fmt: skip
def test_exactly_as_many_strokes_as_asked_are_laid_on_any_canvas(size: tuple[int, int], n: int) -> None:
    target = torch.rand(3, *size, generator=torch.Generator().manual_seed(0))
    strokes = Predicted()(target, n, torch.Generator())
    assert len(strokes) == n
    check_strokes(strokes)


@pytest.mark.parametrize("n", [1, 5, 100, 2600])
def test_levels_become_finer_and_have_all_strokes(n: int) -> None:
    levels = levels_of((96, 128), n)
    assert sum(level.keep for level in levels) == n
    assert all(level.keep <= level.rows * level.columns for level in levels)
    assert all(first.rows <= second.rows for first, second in pairwise(levels))


def test_photographs_and_brushwork_are_painted_as_well_as_when_the_weights_shipped_by_levels_that_add_detail():
    values = []
    for name in ("astronaut", "coffee", "chelsea"):
        target = load_picture(name, 192)
        values.append(psnr(drawn(Predicted()(target, 400, torch.Generator()), target), target))
    assert sum(values) / 3 > 25.2  # measured: 25.7
    target = load_picture("coffee", 192)
    strokes = Predicted(checkpoint="brushed")(target, 400, torch.Generator())
    assert (strokes.opacity == 1).all()
    size = (target.shape[1], target.shape[2])
    assert psnr(draw(FORMS["brushed"], strokes, size, target.mean((1, 2))), target) > 25.2  # measured: 25.7
    target = load_picture("coffee", 160)
    stages = [psnr(drawn(strokes, target), target) for strokes in predict(load_predictor("plain"), target, 300)]
    assert stages == sorted(stages)


def test_large_pictures_are_looked_at_part_by_part_and_it_cannot_be_seen() -> None:
    network = load_predictor("plain")
    side = CELL * (TILE_CELLS + 2 * RECEPTIVE_FIELD + 3)
    target, canvas = torch.rand(2, 1, 3, CELL * 20, side, generator=torch.Generator().manual_seed(0))
    with torch.no_grad():
        whole, parts = network(target, canvas), in_tiles(network)(target, canvas)
    for one, other in zip(whole, parts, strict=True):
        torch.testing.assert_close(one, other, rtol=0, atol=2e-4)


def test_numbers_of_0_are_level_strokes_and_the_way_from_numbers_to_strokes_is_differentiable():
    form = FORMS["plain"]
    strokes = strokes_of(form, torch.zeros(1, NUMBERS), torch.full((1, 3), 0.25), torch.tensor([[20.0, 12.0]]), 8.0)
    half = 8 * form.half_length
    expected = torch.tensor([[20 - half, 12.0], [20.0, 12.0], [20 + half, 12.0]])
    torch.testing.assert_close(curve_of(strokes)[0], expected, rtol=0, atol=1e-4)
    assert float(strokes.width * strokes.scale) == pytest.approx(8 * form.width)
    assert strokes.color.tolist() == [[0.25] * 3]
    random = torch.Generator().manual_seed(1)
    numbers = (0.5 * torch.randn(3, NUMBERS, generator=random, dtype=torch.float64)).requires_grad_()
    mean = torch.full((3, 3), 0.5, dtype=torch.float64)
    middle = torch.rand(3, 2, generator=random, dtype=torch.float64)

    def values(numbers: Tensor) -> Tensor:
        strokes = strokes_of(FORMS["brushed"], numbers, mean, middle, 5.0)
        return torch.cat([value.flatten() for _, value in strokes.items()])

    assert torch.autograd.gradcheck(values, numbers)


def test_colors_are_those_of_least_squares() -> None:
    """Colours agree with the least-squares solution for a matrix whose columns are pictures of single strokes."""
    random = torch.Generator().manual_seed(0)
    target = torch.rand(3, 24, 24, generator=random)
    strokes = Predicted(color_rounds=0)(target, 6, torch.Generator())
    black, background = strokes.map(Tensor.detach), torch.full((3,), 0.5)

    def laid(given: Strokes) -> Tensor:
        return draw(FORMS["plain"], given, (24, 24), background)

    def painted(color: Tensor) -> Tensor:
        return laid(Strokes(**dict(black.items()) | {"color": color}))  # type: ignore[arg-type]

    bare = painted(torch.zeros(6, 3))
    columns = torch.stack([painted(torch.eye(6)[:, k : k + 1].expand(6, 3)) - bare for k in range(6)])[:, 0]
    matrix = columns.flatten(1).T.double()
    exact = torch.linalg.lstsq(matrix, (target - bare).flatten(1).T.double()).solution.clamp(0, 1)
    found = best_colors(strokes, target, laid, 40).color
    seen = matrix.square().sum(0) > 1.0
    torch.testing.assert_close(found[seen].double(), exact[seen], rtol=0, atol=5e-3)


def test_more_rounds_are_never_worse_strokes_go_where_the_focus_is_and_temperature_makes_others():
    target = load_picture("astronaut", 96)
    errors = [psnr(drawn(Predicted(color_rounds=k)(target, 150, torch.Generator()), target), target) for k in (0, 1, 4)]
    assert errors == sorted(errors)
    target = torch.rand(3, 64, 64, generator=torch.Generator().manual_seed(0))
    focus = torch.ones(64, 64)
    focus[:, :32] = 50
    strokes = Predicted()(target, 200, torch.Generator(), focus / focus.mean())
    assert (strokes.position[:, 0] < 32).float().mean() > 0.6
    target = load_picture("coffee", 96)
    warm = Predicted(temperature=1.0)
    one, again, other = (warm(target, 100, torch.Generator().manual_seed(seed)) for seed in (0, 0, 1))
    assert torch.equal(one.position, again.position)
    assert not torch.equal(one.position, other.position)


def test_a_flat_picture_is_painted_flat_by_levels_that_end_as_the_initialiser_and_in_range_untrained():
    target = torch.full((3, 40, 40), 0.3)
    assert psnr(drawn(Predicted()(target, 50, torch.Generator()), target), target) > 40
    painting = brushexp.paint("coffee", painter="predictor", look="plain", resolution=96, strokes=120)
    begun = brushexp.paint("coffee", init="predicted", steps=0, look="plain", resolution=96, strokes=120)
    assert len(painting.strokes) == 120
    assert painting.metrics["psnr"] == pytest.approx(begun.metrics["psnr"], abs=0.3)
    torch.manual_seed(0)
    *_, strokes = predict(StrokePredictor("brushed"), torch.rand(3, 33, 47), 60)
    assert len(strokes) == 60
    check_strokes(strokes)
