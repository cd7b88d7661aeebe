"""Losses on a part of a canvas: times its share, their gradient is that of the whole picture."""

from collections.abc import Callable

import pytest
import torch
from networks import alexnet_state, saved, squeeze_state

from brushexp.pictures.region import Region
from brushexp.plugins.loss.base import Loss, Painting, Surroundings
from brushexp.plugins.loss.lpips import Lpips
from brushexp.plugins.loss.perceptual import Perceptual
from brushexp.plugins.loss.pixel import MeanAbsoluteError, MeanSquaredError
from brushexp.plugins.loss.ssim import StructuralSimilarity
from brushexp.strokes.catalogue import Strokes

Size = tuple[int, int]
STATES = {"alexnet": alexnet_state, "squeeze": squeeze_state}
SIZE = (117, 175)
PLACES = {
    "inside": Region(43, 61, 33, 38),
    "one pixel": Region(58, 90, 1, 1),
    "top left": Region(0, 0, 20, 27),
    "bottom right": Region(SIZE[0] - 21, SIZE[1] - 30, 21, 30),
    "all rows": Region(0, 75, SIZE[0], 22),
    "all": Region(0, 0, *SIZE),
}


def assert_like_the_whole(loss: Loss, region: Region, size: Size, prepare: Callable[[], object] = lambda: None) -> None:
    image, target = torch.rand(2, 3, *size, generator=torch.Generator().manual_seed(7), dtype=torch.float64)
    image = (0.7 * target + 0.3 * image).requires_grad_()
    prepare()
    (slope,) = torch.autograd.grad(loss(Painting(image, target, Strokes.none())), image)
    wanted = region.of(slope)
    part = region.of(image).detach().clone().requires_grad_()
    around = Surroundings(region=region, picture=image.detach(), target=target)
    painting = Painting(part, region.of(target), Strokes.none(), around)
    prepare()
    (found,) = torch.autograd.grad(loss(painting) * painting.share, part)
    assert loss.over_pixels
    assert (found - wanted).norm() <= 1e-5 * wanted.norm()  # alexnet sees nothing of some last rows: both are 0


def network_of(backbone: str, folder) -> dict[str, str]:
    return {"backbone": backbone} | ({"weights": str(saved(folder, STATES[backbone]()))} if backbone in STATES else {})


@pytest.mark.parametrize("jitter", [0, 3])
@pytest.mark.parametrize("region", PLACES.values(), ids=PLACES)
def test_perceptual_on_a_part_is_that_of_the_whole_in_every_shift(region, jitter):
    loss = Perceptual(jitter=jitter).double()
    for number in range(len(loss.shifts)):
        assert_like_the_whole(loss, region, SIZE, lambda number=number: loss.calls.fill_(number))


@pytest.mark.parametrize("taps", [["stem"], ["stem", "b4", "b1.expand"]])
@pytest.mark.parametrize("size", [(97, 142), (64, 111)])
def test_so_it_is_for_other_activations_and_sizes(taps, size):
    loss = Perceptual(jitter=3, taps=taps).double()
    for region in (Region(30, 41, 13, 26), Region(size[0] - 5, 0, 5, 9)):
        assert_like_the_whole(loss, region, size, lambda: loss.calls.fill_(1))


@pytest.mark.parametrize("region", PLACES.values(), ids=PLACES)
def test_lpips_on_a_part_is_that_of_the_whole(region):
    assert_like_the_whole(Lpips().double(), region, SIZE)


def test_lpips_is_that_of_the_whole_where_the_canvas_is_larger_than_what_is_seen():
    size = (43, 417)
    loss = Lpips().double()
    for region in (Region(11, 185, 20, 34), Region(0, 390, 43, 27)):
        assert_like_the_whole(loss, region, size)


@pytest.mark.parametrize("backbone", STATES)
@pytest.mark.parametrize(
    ("tap", "size"), [("relu1", (21, 90)), ("relu1", (91, 62)), ({"alexnet": "relu3", "squeeze": "fire5"}, (50, 333))]
)
def test_networks_that_widen_small_pictures_do_so_in_parts_as_in_the_whole(tmp_path, backbone, tap, size):
    tap = tap if isinstance(tap, str) else tap[backbone]
    loss = Perceptual(jitter=3, taps=[tap], **network_of(backbone, tmp_path)).double()
    middle = size[1] // 2
    for region in (Region(13, middle, 5, 7), Region(0, middle - 20, 12, 21), Region(size[0] - 3, size[1] - 11, 3, 11)):
        for number in (0, 3):
            assert_like_the_whole(loss, region, size, lambda number=number: loss.calls.fill_(number))


@pytest.mark.parametrize("backbone", STATES)
def test_published_distances_on_a_part_are_those_of_the_whole(tmp_path, backbone):
    assert_like_the_whole(Lpips(**network_of(backbone, tmp_path)).double(), Region(9, 130, 22, 17), (40, 367))


@pytest.mark.parametrize("cls", [MeanSquaredError, MeanAbsoluteError, StructuralSimilarity])
@pytest.mark.parametrize("region", PLACES.values(), ids=PLACES)
def test_pixels_and_windows_on_a_part_count_as_in_the_whole(cls, region):
    assert_like_the_whole(cls().double(), region, SIZE)


def test_the_target_of_a_place_is_looked_at_once():
    image, target = torch.rand(2, 3, 60, 70)
    loss, calls = Perceptual(jitter=0), []
    region = Region(10, 21, 15, 17)
    around = Surroundings(region=region, picture=image, target=target)
    painting = Painting(region.of(image), region.of(target), Strokes.none(), around)
    loss(painting)
    loss.network.register_forward_pre_hook(lambda _, inputs: calls.append(inputs[0].shape))
    for _ in range(3):
        loss(painting)
    assert len(calls) == 3
    assert painting.around(9, 4).target is painting.around(9, 4).target
    assert painting.around(9, 4).target is not painting.around(9).target


def test_what_is_seen_grows_with_what_activations_see():
    image, target = torch.rand(2, 3, 200, 210)
    region = Region(85, 90, 10, 12)
    painting = Painting(
        region.of(image), region.of(target), Strokes.none(), Surroundings(region=region, picture=image, target=target)
    )
    sides = []
    for taps in (["stem"], ["b3.expand"], ["b4"]):
        loss, shapes = Perceptual(jitter=0, taps=taps), []
        loss(painting)
        loss.network.register_forward_pre_hook(lambda _, inputs, to=shapes: to.append(inputs[0].shape[-1]))
        loss(painting)
        sides += shapes
    assert sides == sorted(sides)
    assert sides[0] < 24
    assert sides[-1] < 210


def test_one_value_is_the_mean_over_all_where_the_part_is_all() -> None:
    image, target = torch.rand(2, 3, 33, 47, dtype=torch.float64)
    region = Region(0, 0, 33, 47)
    around = Surroundings(region=region, picture=torch.zeros_like(image), target=target)
    for loss in (Lpips(), Perceptual(jitter=0), StructuralSimilarity(), MeanSquaredError()):
        whole, part = (
            loss.double()(Painting(image, target, Strokes.none(), surroundings)) for surroundings in (None, around)
        )
        assert float(part) == pytest.approx(float(whole), rel=1e-9)
