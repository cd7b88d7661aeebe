"""The mathematics of the curve against brute force."""

import pytest
import torch

from brushexp.strokes.bezier import closest_parameter, length_of, point_at


def random_curves(n, bend, dtype=torch.float64):
    start, end = torch.rand(n, 2, dtype=dtype) * 30, torch.rand(n, 2, dtype=dtype) * 30
    return torch.stack([start, (start + end) / 2 + bend * torch.randn(n, 2, dtype=dtype), end], dim=1)


@pytest.mark.parametrize("bend", [0.0, 1.0, 10.0, 30.0])
def test_no_point_of_the_curve_is_nearer(bend):
    curves, points = random_curves(200, bend)[:, None], torch.rand(200, 50, 2, dtype=torch.float64) * 40 - 5
    t = closest_parameter(curves, points)
    found = (point_at(curves, t) - points).norm(dim=-1)
    tried = torch.stack(
        [(point_at(curves, torch.full_like(t, s)) - points).norm(dim=-1) for s in torch.linspace(0, 1, 2001)]
    )
    excess = (found - tried.min(0).values).flatten().sort().values
    assert excess[int(0.9995 * len(excess))] < 2e-3
    assert excess[-1] < 0.5, "near the tip of a fold a point may be given to the other leg, which is nearly as near"


def test_the_nearest_parameter_has_the_gradient_of_finite_differences():
    curve, point = random_curves(4, 3.0), torch.rand(4, 2, dtype=torch.float64) * 30
    inputs = (curve.requires_grad_(), point.requires_grad_())
    assert torch.autograd.gradcheck(closest_parameter, inputs, eps=1e-7, atol=1e-4)


def test_length_agrees_with_a_fine_polyline():
    curves = random_curves(100, 5.0)
    t = torch.linspace(0, 1, 20_001, dtype=torch.float64)
    exact = (point_at(curves[:, None], t.expand(100, -1)).diff(dim=1)).norm(dim=-1).sum(1)
    assert ((length_of(curves) - exact).abs() / exact).max() < 0.02


def test_a_curve_that_is_a_point_has_a_finite_gradient():
    curve = torch.zeros(1, 3, 2, requires_grad=True)
    (length_of(curve).sum() + closest_parameter(curve, torch.ones(1, 2)).sum()).backward()
    assert curve.grad.isfinite().all()
