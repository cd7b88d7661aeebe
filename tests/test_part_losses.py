"""Losses on a part of a canvas: their weighted sum has the gradient of the whole picture there."""

from collections.abc import Iterable, Iterator

import pytest
import torch
from brushexp_losses.perceptual import Perceptual
from brushexp_networks.lpips_loss import Lpips
from networks import saved, state_of
from torch import Tensor
from torch.testing import assert_close

from brushexp.features import base as features
from brushexp.features import open_backbone
from brushexp.pictures.focus import focus_weights
from brushexp.pictures.region import Region
from brushexp.plugins.loss.base import Loss, PaintedView, Surroundings, weighted_sum
from brushexp.registry import plugins
from brushexp.strokes.catalogue import Strokes

SIZE = (117, 175)
PLACES = {
    "inside": Region(43, 61, 33, 38),
    "one pixel": Region(58, 90, 1, 1),
    "top left": Region(0, 0, 20, 27),
    "bottom right": Region(SIZE[0] - 21, SIZE[1] - 30, 21, 30),
    "all": Region(0, 0, *SIZE),
}
OF_PIXELS = {plugin.name: plugin.cls for plugin in plugins("loss") if plugin.cls.looks_at == "pixels"}


def part_of(image: Tensor, target: Tensor, region: Region, focus: Tensor | None = None) -> PaintedView:
    around = Surroundings(region, image.detach(), target, focus)
    part = region.of(image).detach().clone().requires_grad_()
    return PaintedView(part, around.part, Strokes.none(), around, around.part_focus)


def slopes_of(
    loss: Loss, regions: Iterable[Region], size=SIZE, focus: Tensor | None = None
) -> Iterator[tuple[Tensor, Tensor]]:
    """Gradients of the weighted loss in regions: of each part alone, and of the whole picture."""
    noise, target = torch.rand(2, 3, *size, generator=torch.Generator().manual_seed(7), dtype=torch.float64)
    image = (0.7 * target + 0.3 * noise).requires_grad_()

    def slope(painting: PaintedView) -> Tensor:
        if hasattr(loss, "calls"):
            loss.calls.zero_()  # the same shift
        total, terms = weighted_sum({"it": loss}, painting)
        assert list(terms) == ["it"]
        return torch.autograd.grad(total, painting.image)[0]

    whole = slope(PaintedView(image, target, Strokes.none(), focus=focus))
    for region in regions:
        yield slope(part_of(image, target, region, focus)), region.of(whole)


def assert_nearly(result: Tensor, expected: Tensor, *, turned: float, longer: float, where: str = "") -> None:
    assert (result * expected).sum() > (1 - turned) * result.norm() * expected.norm(), where
    assert result.norm() == pytest.approx(float(expected.norm()), rel=longer), where


@pytest.mark.parametrize("focused", [False, True])
@pytest.mark.parametrize("cls", OF_PIXELS.values(), ids=OF_PIXELS)
def test_the_gradient_on_a_part_is_that_of_the_whole(cls, focused):
    loss, focus = cls().double(), focus_weights(torch.rand(SIZE) ** 3, 8) if focused else None
    for place, (result, expected) in zip(PLACES, slopes_of(loss, PLACES.values(), focus=focus), strict=True):
        if loss.exact_on_parts:
            assert_close(result, expected, rtol=1e-5, atol=1e-9, msg=lambda text, place=place: f"{place}: {text}")
        assert_nearly(result, expected, turned=0.05, longer=0.12, where=place)


@pytest.mark.parametrize(("backbone", "tap"), [("alexnet", "relu3"), ("squeeze", "fire5"), ("squeeze", "relu1")])
def test_other_networks_see_enough_around_a_part(tmp_path, backbone, tap):
    weights = str(saved(tmp_path, state_of(backbone)))
    for loss in (Perceptual(backbone=backbone, weights=weights, taps=[tap]), Lpips(backbone=backbone, weights=weights)):
        ((result, expected),) = slopes_of(loss.double(), [Region(40, 130, 72, 67)], (180, 330))
        assert_nearly(result, expected, turned=0.05, longer=0.12)


def test_a_wider_view_stays_the_same_object_as_long_as_steps_look_at_the_same_place():
    image, target = torch.rand(2, 3, 60, 70)
    focus = focus_weights(torch.rand(60, 70), 8)
    region = Region(10, 21, 15, 17)
    painting = part_of(image, target, region, focus)
    wide = painting.around(9, 4)
    assert wide.surroundings.region == Region(0, 12, 36, 38)
    for value, whole in ((wide.image, image), (wide.target, target), (wide.focus, focus)):
        assert torch.equal(value, wide.surroundings.region.of(whole))
    assert (wide.share, painting.share) == (36 * 38 / 4200, 15 * 17 / 4200)
    wide.image.sum().backward()
    assert (painting.image.grad == 1).all()
    assert painting.around(9, 4).target is wide.target
    assert painting.around(9, 4).surroundings is wide.surroundings
    assert painting.around(9).target is not wide.target
    assert painting.around(0) is painting
    whole = PaintedView(image, target, Strokes.none())
    assert whole.around(9) is whole


@pytest.mark.parametrize("grid", [1, 2, 16])
def test_wider_regions_begin_on_the_grid_and_are_padded_as_the_whole(grid):
    for size in ((37, 90), (64, 33), (5, 200)):
        for region in (Region(0, 0, 3, 7), Region(2, 30, 3, 1), Region(size[0] - 2, size[1] - 5, 2, 5)):
            for margin in (0, 3, 40):
                wide = region.widened(margin, size, grid)
                assert wide.top % grid == wide.left % grid == 0
                assert (size[0] - wide.height) % grid == (size[1] - wide.width) % grid == 0
                for begin, length, first, n, side in (
                    (wide.top, wide.height, region.top, region.height, size[0]),
                    (wide.left, wide.width, region.left, region.width, size[1]),
                ):
                    assert 0 <= begin <= max(first - margin, 0)
                    assert min(first + n + margin, side) <= begin + length <= side
                    assert length < n + 2 * margin + 2 * grid


def test_tiles_hold_every_activation_once(monkeypatch):
    monkeypatch.setattr(features, "TILE_PIXELS", 32)
    network, taps = open_backbone("effl0"), ["stem", "b2", "b3.expand"]
    picture = torch.rand(3, 77, 101)
    expected = network(picture[None], taps)
    tiles = list(network.tiled(picture, taps))
    assert len(tiles) == 12
    for tap, pieces in zip(taps, zip(*tiles, strict=True), strict=True):
        result, everything = torch.cat(pieces, 1), expected[tap][0].flatten(1)
        assert_close(result.sort(1).values, everything.sort(1).values, rtol=1e-4, atol=1e-4)
