"""Test that the neural renderer's textures depend on shape and brush, and that compiled and eager code agree."""

from dataclasses import replace

import pytest
import torch
from brushexp_training.renderers.neural import NUMBERS, Neural, shape_numbers

from brushexp.compositing.layers import Layers
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.renderer.base import window_pictures
from brushexp.strokes.prior import clamp_to_prior, parameters_of, sample_prior, strokes_of


def lively(**options) -> Neural:
    """Build a tiny network whose textures vary between texels."""
    torch.manual_seed(0)
    renderer = Neural(**{"width": 4, "dense": 16, "code": 3, "brushes": 3, "checkpoint": None, **options})
    with torch.no_grad():
        renderer.last.weight.mul_(40)
        renderer.last.bias[:4] = 0.5
        for stage in renderer.stages:
            torch.nn.init.normal_(stage.maps)
    return renderer.eval().requires_grad_(False)


def parameters(n: int = 6) -> torch.Tensor:
    return parameters_of(sample_prior(n))


@pytest.mark.parametrize("training", [True, False])
def test_pictures_of_the_compiled_parts_are_those_of_eager_code(training):
    renderer, side = lively().train(training), 64
    strokes = strokes_of(parameters())
    strokes = replace(strokes, position=strokes.position + 0.5 * side)
    layers = renderer(strokes)
    fast, slow = layers.pictures(side), Layers.pictures(layers, side)
    assert fast[:, 3].std() > 0.05
    torch.testing.assert_close(fast[:, 3], slow[:, 3], atol=2e-3, rtol=0)
    torch.testing.assert_close(fast[:, :3] * fast[:, 3:], slow[:, :3] * slow[:, 3:], atol=2e-3, rtol=0)
    canvas = Tiled()(layers, torch.arange(6), (side, side), torch.ones(3)).image
    over = torch.ones(3, side, side)
    for picture in slow.flip(0):  # the first stroke lies on top
        over = over * (1 - picture[3:]) + picture[:3] * picture[3:]
    torch.testing.assert_close(canvas, over, atol=1e-2, rtol=0)


def test_training_moves_every_weight_and_the_number_of_a_stroke_decides_its_brush_wherever_it_stands():
    renderer = lively().requires_grad_(True).train()
    window_pictures(renderer, parameters(9), 64).square().mean().backward()
    for name, weight in renderer.named_parameters():
        assert bool(weight.grad.isfinite().all()), name
        assert bool((weight.grad != 0).any()), name
    renderer, shapes = lively(), parameters(1).repeat(4, 1)
    pictures = window_pictures(renderer, shapes, 64, torch.tensor([0, 1, 2, 3]))
    assert torch.equal(pictures[0], pictures[3])
    assert (pictures[0] - pictures[1]).abs().max() > 0.01
    torch.testing.assert_close(window_pictures(renderer, shapes[:2], 64, torch.tensor([5, 4])), pictures[[2, 1]])
    assert renderer(strokes_of(shapes[:0])).sheets.texels.isfinite().all(), "an empty set of strokes works"
    strokes = strokes_of(parameters(3))
    small, large = (lively()(replace(strokes, scale=torch.full((3,), scale))) for scale in (64.0, 256.0))
    assert torch.equal(small.sheets.texels, large.sheets.texels)
    assert torch.equal(small.look, large.look)
    reduced = lively()(replace(strokes, scale=torch.full((3,), 20.0)))
    assert reduced.look.tolist() == [1, 3, 5], "smaller windows use means of texels"


def test_what_the_network_is_told_is_of_the_order_of_one_and_unprojected_strokes_are_drawn_as_they_are():
    assert shape_numbers(parameters(2000)).abs().max() < 6
    for odd in (torch.zeros(1, 10), torch.full((1, 10), -1.0), 9 * torch.ones(1, 10)):
        assert shape_numbers(odd).shape == (1, NUMBERS)
        assert bool(shape_numbers(odd).isfinite().all())
    far = parameters(2)
    far[:, 6] = 6.0  # five times as thick as any training stroke
    near = parameters_of(clamp_to_prior(strokes_of(far)))
    free, projected = (lively(project=project)(strokes_of(far)).sheets.texels for project in (False, True))
    assert not torch.equal(free, projected)
    assert bool(free.isfinite().all())
    assert torch.equal(lively(project=False)(strokes_of(near)).sheets.texels, lively()(strokes_of(near)).sheets.texels)
