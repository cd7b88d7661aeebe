"""Test that patch renderers draw valid windows with finite gradients, and that their options take effect."""

from dataclasses import replace
from itertools import product

import pytest
import torch
from brushexp_training.renderers.inverse_vgg import (
    ACTIVATIONS,
    COORDINATES,
    NORMALISATIONS,
    UPSAMPLING,
    InverseVGG,
    stroke_planes,
)
from refusals import refuses
from torch.nn import functional

from brushexp.compositing.windows import Windows
from brushexp.contracts.networks import CoordConv, Noise, window_planes
from brushexp.plugins.renderer.base import LEAST_ALPHA, PRECISIONS, PatchRenderer, window_pictures
from brushexp.registry import build_named, plugins
from brushexp.strokes.prior import clamp_to_prior, parameters_of, sample_prior, strokes_of

NAMES = [plugin.name for plugin in plugins("renderer") if issubclass(plugin.cls, PatchRenderer)]
TINY = {"width": 4, "widest": 8, "dense": [16], "checkpoint": None}


def tiny(**options) -> InverseVGG:
    return InverseVGG(**{**TINY, **options})


def parameters(n: int = 5) -> torch.Tensor:
    return parameters_of(sample_prior(n))


@pytest.fixture(params=NAMES)
def renderer(request) -> PatchRenderer:
    """Build each patch renderer with random weights, in evaluation mode."""
    return build_named("renderer", request.param, {"checkpoint": None}).eval()


def test_it_draws_windows_in_range_with_a_finite_gradient_in_every_number(renderer):
    inputs = parameters().requires_grad_()
    images = renderer.draw(inputs)
    assert (images.shape, images.dtype) == ((5, 4, renderer.window, renderer.window), torch.float32)
    assert bool(((images >= 0) & (images <= 1)).all())
    (images[:, :3] * images[:, 3:]).sum().backward()
    assert bool(inputs.grad.isfinite().all())
    assert bool((inputs.grad.abs().sum(0) > 0).all())
    with torch.no_grad():
        assert torch.equal(renderer.draw(inputs), images), "a stroke is drawn the same twice, and alone"
        torch.testing.assert_close(renderer.draw(inputs[2:3]), images[2:3], rtol=1e-4, atol=1e-5)


def test_strokes_outside_the_range_are_drawn_at_its_edge_and_canvases_have_the_pictures_of_windows(renderer):
    far = 30 * parameters()
    far[0] = 0
    with torch.no_grad():
        images = window_pictures(renderer, far, renderer.window)
        nearest = window_pictures(renderer, parameters_of(clamp_to_prior(strokes_of(far))), renderer.window)
    assert bool(images.isfinite().all())
    torch.testing.assert_close(images, nearest)
    strokes = sample_prior(3)
    strokes = replace(strokes, position=strokes.position + 40, scale=torch.tensor([20.0, 64.0, 100.0]))
    with torch.no_grad():
        layers = renderer(strokes)
        assert isinstance(layers, Windows)
        drawn = renderer.draw(parameters_of(strokes))
    drawn[:, 3] *= drawn[:, 3] >= LEAST_ALPHA
    torch.testing.assert_close(layers.images, drawn)


def test_without_projection_strokes_outside_the_range_are_what_the_bare_network_draws():
    renderer, far = tiny(project=False).eval(), 1.5 * parameters()
    with torch.no_grad():
        bare = renderer.draw(far)
        images = window_pictures(renderer, far, renderer.window)
        assert not torch.equal(window_pictures(tiny().eval(), far, renderer.window), images)
    bare[:, 3] *= bare[:, 3] >= LEAST_ALPHA
    torch.testing.assert_close(images, bare)
    assert torch.equal(renderer.clamp(strokes_of(far)).start, strokes_of(far).start)


COMBINED = [{"coordconv": c, "noise": n, "tint": t} for c, n, t in product(COORDINATES, (0.0, 1.0), (False, True))]
COMBINED += [{"activation": a, "normalisation": n} for a, n in product(ACTIVATIONS, NORMALISATIONS)]


@pytest.mark.parametrize("options", COMBINED, ids=str)
def test_the_layers_can_be_combined_and_trained(options):
    renderer = tiny(**options).train()
    pictures = renderer.draw(parameters())
    assert pictures.shape == (5, 4, 64, 64)
    pictures.mean().backward()
    assert all(bool(weight.grad.isfinite().all()) for weight in renderer.parameters())


@pytest.mark.parametrize("upsampling", UPSAMPLING)
@pytest.mark.parametrize(("window", "subpixel"), [(64, 1), (64, 4), (128, 2), (256, 4)])
def test_every_window_is_reached(upsampling, window, subpixel):
    renderer = tiny(upsampling=upsampling, window=window, subpixel=subpixel)
    with torch.no_grad():
        assert renderer.draw(parameters(2)).shape == (2, 4, window, window)


def test_the_planes_of_a_straight_stroke_are_its_coordinates():
    strokes = strokes_of(torch.tensor([[-0.5, -0.2, 0.0, 0.1, 0.5, 0.4, 0.0, 0.0, 0.0, 0.0]]))
    planes = stroke_planes(parameters_of(strokes), 64)[0]
    line = (torch.arange(64) + 0.5) / 32 - 1
    offset = torch.stack([line[None] + 0.5 + 0 * line[:, None], line[:, None] + 0.2 + 0 * line[None]])
    chord = (strokes.end - strokes.start)[0]
    length = chord.norm()
    along = (offset * chord[:, None, None]).sum(0) / length
    across = (chord[0] * offset[1] - chord[1] * offset[0]) / length / strokes.width
    torch.testing.assert_close(planes[0], 2 * (along / length).clamp(-0.5, 1.5) - 1)
    torch.testing.assert_close(planes[1], across.clamp(-3, 3))
    beyond = torch.maximum(-along, along - length).clamp_min(0) / strokes.width
    torch.testing.assert_close(planes[2], beyond.clamp_max(3.0))
    torch.testing.assert_close(planes[3], torch.exp(-(planes[1] ** 2) / 4) * torch.cos(torch.pi * planes[1]))


@pytest.mark.parametrize("zoom", [2, 4])
def test_folded_planes_are_planes_folded(zoom):
    folded = functional.pixel_unshuffle(stroke_planes(parameters(), 16), zoom)
    torch.testing.assert_close(stroke_planes(parameters(), 16, zoom), folded)


@pytest.mark.parametrize("first", [0, 2, 4], ids=["start", "control", "end"])
def test_places_on_a_degenerate_stroke_are_finite_with_their_gradient(first):
    inputs = 0.6 * torch.ones(2, 10)
    inputs[1] = 0
    inputs[0, first : first + 2] = -0.6  # two of the three points coincide; in the second stroke all of them do
    inputs.requires_grad_()
    planes = stroke_planes(inputs, 16)
    planes.square().sum().backward()
    assert bool(planes.isfinite().all())
    assert bool(inputs.grad.isfinite().all())


def test_noise_is_fresh_in_training_fixed_in_painting_and_of_the_size_of_the_signal_at_first():
    renderer = tiny(noise=1.0)
    with torch.no_grad():
        assert not torch.equal(renderer.train().draw(parameters()), renderer.draw(parameters()))
        assert torch.equal(renderer.eval().draw(parameters()), renderer.draw(parameters()))
        again = tiny(noise=1.0)
        again.load_state_dict(renderer.state_dict())
        assert torch.equal(again.draw(parameters()), renderer.draw(parameters()))
    signals, noisy = [], []
    for strength, sizes in ((0.0, signals), (1.0, noisy)):
        torch.manual_seed(0)
        renderer = tiny(noise=strength, width=32, widest=96, dense=[256, 256]).train()
        for layer in renderer.convolving:
            layer.register_forward_hook(lambda layer, inputs, output, sizes=sizes: sizes.append(float(output.std())))
        with torch.no_grad():
            renderer.draw(parameters())
    added = (noisy[0] ** 2 - signals[0] ** 2) ** 0.5  # at the first layer, whose signal comes without noise
    assert 0.9 < added < 1.1
    assert all(1 / 3 < signal < 3 for signal in signals)


def test_networks_without_dense_layers_are_refused_and_measuring_their_time_changes_nothing():
    refuses(r"renderer\.dense=\[\]", tiny, dense=[])
    renderer = tiny(normalisation="batch").train()
    before = {name: value.clone() for name, value in renderer.state_dict().items()}
    assert 0 < renderer.seconds_per_stroke() < 60
    assert renderer.training
    assert all(value.grad is None for value in renderer.parameters())
    for name, value in renderer.state_dict().items():
        torch.testing.assert_close(value, before[name], atol=0, rtol=0)


@pytest.mark.parametrize("name", NAMES)
def test_sixteen_bits_draw_and_pull_as_thirty_two_do(name):
    strokes, drawn, pulls = sample_prior(6), [], []
    for precision in ("float32", "bfloat16"):
        torch.manual_seed(1)
        options = {"checkpoint": None, "precision": precision}
        renderer = build_named("renderer", name, options).requires_grad_(False).eval()
        leaves = strokes.map(lambda value: value.clone().requires_grad_())
        images = renderer(leaves).images
        assert images.dtype == torch.float32
        assert {weight.dtype for weight in renderer.parameters()} == {torch.float32}
        (images * torch.linspace(-1, 1, images[0].numel()).reshape(images[0].shape)).sum().backward()
        assert leaves.width.grad.dtype == torch.float32
        drawn.append(images.detach()[:, 3:] * images.detach())
        pulls.append(torch.cat([getattr(leaves, key).grad.flatten() for key in ("start", "control", "end", "width")]))
    assert not torch.equal(*drawn)
    torch.testing.assert_close(*drawn, atol=0.02, rtol=0)
    assert (drawn[0] - drawn[1]).square().mean().sqrt() < 2e-3
    assert torch.nn.functional.cosine_similarity(*pulls, dim=0) > 0.99
    same = [tiny(precision=precision) for precision in PRECISIONS]
    same[1].load_state_dict(same[0].state_dict())
    assert torch.equal(*(renderer.train()(strokes).images for renderer in same)), "training uses its own precision"


def test_the_public_layers_are_those_of_the_network():
    x = torch.rand(2, 8, 16, 16)
    layer = CoordConv(8, 4, planes=2)
    planes = window_planes(16)
    both = torch.cat([x, planes.expand(2, -1, -1, -1)], dim=1)
    inner = functional.pad(layer.coordinates.weight, (1, 1, 1, 1))  # a 3 x 3 convolution with one non-zero weight
    weight = torch.cat([layer.convolution.weight, inner], dim=1)
    expected = functional.conv2d(both, weight, layer.convolution.bias, padding=1)
    torch.testing.assert_close(layer(x, planes), expected)
    assert planes[0, 0, 3].tolist() == pytest.approx([(k + 0.5) / 8 - 1 for k in range(16)])
    assert torch.equal(planes[0, 0], planes[0, 1].T)
    noise = Noise(8, 16, strength=0.5).eval()
    torch.testing.assert_close(noise(x), x + 0.5 * noise.grain)
    ours = build_named("renderer", "inverse_vgg", {"noise": 0.5, "checkpoint": None}).convolving
    grains = {layer.grain.shape[-1]: layer.grain for layer in ours}
    assert torch.equal(grains[16], noise.grain)
    assert not torch.equal(noise.train()(x), noise(x))
    noise(x).sum().backward()
    assert noise.strength.grad.abs().min() > 0
