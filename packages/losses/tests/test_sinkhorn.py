"""Test that the transport loss agrees with dense matrices, is finite, and moves strokes where pixel losses cannot."""

import pytest
import torch
from brushexp_losses.sinkhorn import Sinkhorn, masses
from torch import Tensor
from torch.testing import assert_close

from brushexp.pictures.load import downsample
from brushexp.pictures.region import Region
from brushexp.plugins.loss.base import PaintedView, Surroundings
from brushexp.plugins.loss.mse import MeanSquaredError
from brushexp.strokes.catalogue import Strokes


def judged(loss: Sinkhorn, image: Tensor, target: Tensor) -> Tensor:
    return loss(PaintedView(image, target, Strokes.none()))


def dense(image: Tensor, target: Tensor, epsilon: float, iterations: int, floor: float) -> float:
    """Compute the divergence with a dense cost matrix in the log domain, channel by channel."""
    height, width = image.shape[1:]
    rows, columns = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    places = torch.stack([rows, columns], -1).reshape(-1, 2).double() / max(height, width)
    cost = (places[:, None] - places).square().sum(-1)
    blurs = [2.0]
    while blurs[-1] > epsilon:
        blurs.append(max(blurs[-1] / 2, epsilon))
    blurs += [epsilon] * iterations
    total = 0.0
    for ours, theirs in zip(image, target, strict=True):
        a, b = ((x.flatten() + floor) / (x + floor).sum() for x in (ours, theirs))

        def cheapest(mass: Tensor, potential: Tensor, blur: float) -> Tensor:
            return -blur * torch.logsumexp(mass.log() + (potential - cost) / blur, dim=1)

        def potentials(a: Tensor, b: Tensor) -> tuple[Tensor, Tensor]:
            f, g = cheapest(b, torch.zeros_like(b), blurs[0]), cheapest(a, torch.zeros_like(a), blurs[0])
            for blur in blurs[1:]:
                f, g = (f + cheapest(b, g, blur)) / 2, (g + cheapest(a, f, blur)) / 2
            return cheapest(b, g, epsilon), cheapest(a, f, epsilon)

        (f, g), (p, _), (q, _) = potentials(a, b), potentials(a, a), potentials(b, b)
        total += float(a @ (f - p) + b @ (g - q)) / 3
    return total


@pytest.mark.parametrize("size", [(1, 7), (6, 9), (12, 5)])
@pytest.mark.parametrize("options", [{}, {"epsilon": 0.05, "iterations": 2, "floor": 0.01}])
def test_divergence_agrees_with_dense_matrices(size, options):
    image, target = torch.rand(2, 3, *size, dtype=torch.float64) ** 4
    loss = Sinkhorn(**options)
    expected = dense(image, target, **{"epsilon": 0.01, "iterations": 5, "floor": 0.001} | options)
    assert float(judged(loss, image, target)) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("size", "small"), [((48, 96), (12, 24)), ((7, 5), (7, 5)), ((1, 100), (1, 24)), ((24, 25), (23, 24))]
)
def test_pictures_are_shrunk_to_the_side(size, small):
    mass = masses(downsample(torch.rand(3, *size), 24), 0.001)
    assert mass.shape == (3, *small)
    assert_close(mass.sum((1, 2)), torch.ones(3, dtype=torch.float64))


@pytest.mark.parametrize("size", [(48, 96), (7, 5), (25, 24)])
def test_a_part_is_looked_at_in_the_whole_canvas(size, monkeypatch):
    calls = []
    monkeypatch.setattr(
        Sinkhorn, "_masses_and_potential", lambda *args, do=Sinkhorn._masses_and_potential: calls.append(1) or do(*args)
    )
    picture, target = torch.rand(2, 3, *size, dtype=torch.float64)
    height, width = size
    loss = Sinkhorn()
    middle = Region(height // 3, width // 4, height // 2, width // 5)
    for region in (middle, Region(0, 0, 3, 2), Region(height - 5, width - 4, 5, 4)):
        around = Surroundings(region=region, picture=picture, target=target)
        for _ in range(2):
            part = torch.rand(3, region.height, region.width, dtype=torch.float64, requires_grad=True)
            result = loss(PaintedView(part, region.of(target), Strokes.none(), around))
            region.of(picture).copy_(part.detach())
            whole = picture.clone().requires_grad_()
            expected = judged(Sinkhorn(), whole, target)
            assert_close(result, expected, rtol=1e-9, atol=1e-12)
            slope = torch.autograd.grad(expected, whole)[0]
            assert_close(torch.autograd.grad(result, part)[0], region.of(slope), rtol=1e-6, atol=1e-12)
    assert len(calls) == 1 + 6  # the loss itself, and once for each of the others
    assert loss.looks_at == "canvas"


def disc(row: Tensor, column: Tensor) -> Tensor:
    """Draw a bright disc with soft edges on black, 48 x 64 pixels."""
    rows, columns = torch.meshgrid(torch.arange(48.0), torch.arange(64.0), indexing="ij")
    distance = (rows - row) ** 2 + (columns - column) ** 2
    return torch.sigmoid(4 - distance.add(1e-6).sqrt()).expand(3, -1, -1)


def test_a_disc_far_from_its_place_is_drawn_there_where_pixels_see_nothing():
    goal, place = torch.tensor([36.0, 50.0]), torch.tensor([12.0, 14.0], requires_grad=True)
    pixels, slope = (
        torch.autograd.grad(loss(PaintedView(disc(*place), disc(*goal), Strokes.none())), place)[0]
        for loss in (MeanSquaredError(), Sinkhorn())
    )
    assert pixels.norm() < 1e-6
    assert slope.norm() > 1e-3
    assert torch.cosine_similarity(-slope, goal - place, dim=0) > 0.98
