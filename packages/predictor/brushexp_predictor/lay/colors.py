"""Find the best colours for strokes of fixed shape by least squares, because a painting is linear in its colours."""

from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor

from brushexp.contracts.strokes import Strokes

ROUNDS = 3  # nearly enough; another round gains 0.01 to 0.04 dB
LEAST_SEEN, TINY = 1e-3, 1e-12  # lower bounds of divisors: visible pixels of a stroke, and sums of squares
Paint = Callable[[Strokes], Tensor]  # function that draws strokes as a picture (3, H, W)


def best_colors(strokes: Strokes, target: Tensor, draw: Paint, rounds: int) -> Strokes:
    """Lower the squared error of stroke colours by conjugate gradients (Hestenes and Stiefel, 1952).

    Each round draws the strokes forward and backward and costs about as much as a gradient step. Rounds are
    preconditioned by each stroke's visible area. Colours are clamped to [0, 1] at the end.

    Args:
        strokes: N strokes, whose shapes stay fixed.
        target: picture (3, H, W).
        draw: function that draws strokes; affine in their colours.
        rounds: number of rounds; 0 changes nothing.
    """
    if not rounds:
        return strokes
    fixed = strokes.map(Tensor.detach)
    color = fixed.color.clone().requires_grad_()
    with torch.enable_grad():
        picture = draw(replace(fixed, color=color))
    painted = picture.detach()

    def pulled(residual: Tensor) -> Tensor:
        """Sum the pixels (3, H, W), weighted by each colour's contribution, which does not depend on the colours."""
        return torch.autograd.grad(picture, color, residual, retain_graph=True)[0]

    inverse = 1 / pulled(torch.ones_like(painted)).clamp_min(LEAST_SEEN)
    solution, residual = fixed.color, target - painted
    direction, before = torch.zeros_like(solution), torch.full((3,), torch.inf).to(solution)
    for _ in range(rounds):
        pull = pulled(residual)
        scaled = inverse * pull
        strength = (pull * scaled).sum(0)
        direction, before = scaled + strength / before * direction, strength.clamp_min(TINY)
        with torch.no_grad():
            change = draw(replace(fixed, color=fixed.color + direction)) - painted
        step = strength / change.square().sum((1, 2)).clamp_min(TINY)
        solution = solution + step * direction
        residual = residual - step[:, None, None] * change
    return replace(fixed, color=solution.clamp(0, 1))
