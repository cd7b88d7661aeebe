"""Windows are blended by compiled code exactly as the reference blends them."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from brushexp.compositing.tile_lists import tile_lists
from brushexp.compositing.windows import Windows
from brushexp.errors import UserError
from brushexp.plugins.blend.dense import Dense
from brushexp.plugins.blend.tiled import Backend, Tiled

BACKGROUND = torch.tensor([0.2, 0.5, 0.9])
FIELDS = ("images", "position", "scale", "opacity")


def random_patches(n, size, *, side=16, seed=0, scales=(2.0, 100.0)):
    """``n`` windows of noise on and around a canvas of ``size`` (H, W)."""
    generator = torch.Generator().manual_seed(seed)

    def uniform(*shape):
        return torch.rand(*shape, generator=generator)

    return Windows(
        images=uniform(n, 4, side, side),
        position=(uniform(n, 2) * 1.4 - 0.2) * torch.tensor([size[1], size[0]]),
        scale=scales[0] * (scales[1] / scales[0]) ** uniform(n),
        opacity=uniform(n),
        color=torch.zeros(n, 3),
    )


def paint_with_gradient(blend, layers, size, weight, *, order=None, target=None, dtype=torch.float32):
    """Canvas, and the gradient of its weighted sum with respect to each field, in float64."""
    fields = {name: getattr(layers, name).to(dtype).clone().requires_grad_() for name in FIELDS}
    order = torch.arange(len(layers.scale)) if order is None else order
    target = None if target is None else target.to(dtype)
    canvas = blend(Windows(**fields, color=layers.color.to(dtype)), order, size, BACKGROUND.to(dtype), target)
    (canvas.image * weight.to(dtype)).sum().backward()
    return canvas, {name: value.grad.double() for name, value in fields.items()}


def assert_agree(layers, size, *, blend=None, **options):
    """Value to 1e-4, gradient to 1e-3 of its size, against the reference in float64."""
    weight = torch.randn(3, *size)
    blend = Tiled(opaque=0.0, kernel=Backend.numba) if blend is None else blend
    canvas, gradient = paint_with_gradient(blend, layers, size, weight, **options)
    exact, slope = paint_with_gradient(Dense(), layers, size, weight, dtype=torch.float64, **options)
    torch.testing.assert_close(canvas.image.double(), exact.image, atol=1e-4, rtol=0)
    for name in FIELDS:
        error, scale = (gradient[name] - slope[name]).norm(), slope[name].norm()
        assert error <= 1e-3 * scale + 1e-5 * weight.norm(), f"{name}: off by {error:.2g}, its gradient is {scale:.2g}"


@settings(max_examples=30, deadline=None)
@given(
    n=st.integers(0, 30),
    height=st.integers(1, 30),
    width=st.integers(1, 45),
    side=st.sampled_from([1, 2, 7, 16]),
    seed=st.integers(0, 10_000),
)
def test_windows_agree_with_the_reference(n, height, width, side, seed):
    order = torch.randperm(n, generator=torch.Generator().manual_seed(seed))
    assert_agree(random_patches(n, (height, width), side=side, seed=seed), (height, width), order=order)


def test_the_eager_pass_agrees_too():
    blend = Tiled(opaque=0.0, kernel=Backend.torch)
    assert_agree(random_patches(20, (21, 34)), (21, 34), blend=blend)


ONE = {
    "pixel by pixel": ((16.001, 12.001), 16.0),  # not quite: at a kink the slope is a matter of taste
    "twice as large": ((16.0, 12.0), 32.0),
    "half as large": ((16.0, 12.0), 8.0),
    "between pixels": ((13.3, 7.9), 21.7),
    "over the edge": ((-3.0, 24.0), 20.0),
    "off the canvas": ((500.0, 12.0), 20.0),
    "far off the canvas": ((-1e5, 12.0), 20.0),
    "larger than the canvas": ((15.0, 11.0), 300.0),
    "less than a pixel": ((15.2, 11.4), 0.3),
}


@pytest.mark.parametrize("kind", ONE)
def test_one_window_anywhere(kind):
    centre, scale = ONE[kind]
    images = torch.rand(1, 4, 16, 16)
    layers = Windows(
        images, torch.tensor([centre]), torch.tensor([scale]), torch.tensor([0.7]), color=torch.zeros(1, 3)
    )
    assert_agree(layers, (24, 33))


def test_no_windows_leave_the_bare_canvas():
    canvas, gradient = paint_with_gradient(Tiled(), random_patches(0, (9, 13)), (9, 13), torch.randn(3, 9, 13))
    torch.testing.assert_close(canvas.image.detach(), BACKGROUND.view(3, 1, 1).expand(3, 9, 13))
    assert gradient["images"].shape == (0, 4, 16, 16)


def test_a_window_may_be_empty_or_nearly():
    layers = random_patches(4, (24, 33), scales=(20.0, 40.0))
    layers.images[0, 3] = 0
    layers.images[1, 3] = 0
    layers.images[1, 3, 5, 9] = 1
    layers.images[2, 3, :, :4] = 0
    weight = torch.randn(3, 24, 33)
    canvas, gradient = paint_with_gradient(Tiled(opaque=0), layers, (24, 33), weight)
    exact, slope = paint_with_gradient(Dense(), layers, (24, 33), weight, dtype=torch.float64)
    torch.testing.assert_close(canvas.image.double(), exact.image, atol=1e-4, rtol=0)
    for name in ("position", "scale", "opacity"):
        torch.testing.assert_close(gradient[name], slope[name], rtol=1e-3, atol=1e-3)
    shows = layers.images[:, 3] > 0
    torch.testing.assert_close(gradient["images"][:, 3][shows], slope["images"][:, 3][shows], rtol=1e-3, atol=1e-3)
    assert gradient["images"].isfinite().all()


def test_tiles_where_a_window_shows_nothing_are_not_listed():
    layers = random_patches(1, (64, 64), scales=(63.0, 64.0))
    layers = Windows(layers.images, torch.full((1, 2), 32.0), layers.scale, layers.opacity, layers.color)
    order = torch.zeros(1, dtype=torch.long)
    layers.images[0, 3, :, 4:] = 0
    boxes = layers.compiled().boxes
    assert 0 < len(tile_lists(*boxes, order, (64, 64), boxes_only=True).stroke) <= 3 * 8
    assert len(tile_lists(layers.curve, layers.reach, order, (64, 64)).stroke) == 64


def test_accuracy_is_measured_in_the_same_pass():
    layers, target, order = random_patches(30, (20, 33), scales=(5.0, 20.0)), torch.rand(3, 20, 33), torch.randperm(30)
    layers.position[3] = 500
    weight = torch.randn(3, 20, 33)
    canvas, _ = paint_with_gradient(Tiled(), layers, (20, 33), weight, order=order, target=target)
    exact, _ = paint_with_gradient(Dense(), layers, (20, 33), weight, order=order, target=target, dtype=torch.float64)
    assert exact.accuracy.isnan().any()
    torch.testing.assert_close(canvas.accuracy.double(), exact.accuracy, atol=1e-4, rtol=0, equal_nan=True)


@pytest.mark.parametrize("opaque", [1e-4, 1 / 512, 0.1])
def test_what_is_skipped_cannot_be_seen(opaque):
    layers, weight = random_patches(300, (40, 40)), torch.randn(3, 40, 40)
    image = paint_with_gradient(Tiled(opaque=opaque), layers, (40, 40), weight)[0].image
    exact = paint_with_gradient(Dense(), layers, (40, 40), weight)[0].image
    assert (image - exact).abs().max() <= opaque + 1e-5


def test_one_thread_and_two_give_the_same_bits():
    layers, weight, results = random_patches(100, (60, 70)), torch.randn(3, 60, 70), []
    for threads in (1, 2):
        torch.set_num_threads(threads)
        canvas, gradient = paint_with_gradient(Tiled(), layers, (60, 70), weight, target=torch.zeros(3, 60, 70))
        results.append([canvas.image, canvas.accuracy.nan_to_num(), *gradient.values()])
    torch.set_num_threads(1)
    assert all(torch.equal(a, b) for a, b in zip(*results, strict=True))


def test_pictures_may_lie_in_memory_as_they_like():
    layers = random_patches(10, (20, 30))
    turned = layers.images.to(memory_format=torch.channels_last)
    assert not turned.is_contiguous()
    other = Windows(turned, layers.position, layers.scale, layers.opacity, layers.color)
    images = [Tiled()(kind, torch.arange(10), (20, 30), BACKGROUND).image for kind in (layers, other)]
    assert torch.equal(*images)


def test_the_compiled_pass_refuses_what_it_cannot_do():
    layers, weight = random_patches(2, (8, 8)), torch.zeros(3, 8, 8)
    with pytest.raises(UserError, match=r"use blend\.kernel=auto"):
        paint_with_gradient(Tiled(kernel=Backend.numba), layers, (8, 8), weight, dtype=torch.float64)
