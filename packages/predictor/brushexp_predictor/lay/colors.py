"""Find the best colours for strokes of fixed shape by least squares; paintings are affine functions of the colours."""

from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor

from brushexp.contracts.strokes import Strokes

ROUNDS = 3  # nearly enough; another round gains 0.01 to 0.04 dB
LEAST_SEEN, TINY = 1e-3, 1e-12  # lower bounds of divisors: visible pixels of a stroke, and sums of squares
Paint = Callable[[Strokes], Tensor]  # function that draws strokes as a picture (3, H, W)


def best_colors(strokes: Strokes, target: Tensor, draw: Paint, rounds: int) -> Strokes:
    """Optimise stroke colours by conjugate gradients (Hestenes and Stiefel, 1952) to minimise the squared error.

    Each round needs one forward and one backward pass through the renderer, and so costs about as much as a gradient
    step. The preconditioner is each stroke's visible area. Colours are clamped to [0, 1] at the end.

    Args:
        strokes: N strokes, whose shapes stay fixed.
        target: picture (3, H, W).
        draw: function that draws strokes, and is affine in their colours.
        rounds: number of rounds; 0 leaves the colours unchanged.
    """
    if not rounds:
        return strokes
    fixed = strokes.map(Tensor.detach)
    color = fixed.color.clone().requires_grad_()
    with torch.enable_grad():
        picture = draw(replace(fixed, color=color))
    painted = picture.detach()

    def sum_pixels(residual: Tensor) -> Tensor:
        """Sum ``residual`` (3, H, W) over pixels for each stroke, weighted by the stroke's share of each pixel.

        These weights do not depend on the colours.
        """
        return torch.autograd.grad(picture, color, residual, retain_graph=True)[0]

    inverse = 1 / sum_pixels(torch.ones_like(painted)).clamp_min(LEAST_SEEN)
    solution, residual = fixed.color, target - painted
    direction, before = torch.zeros_like(solution), torch.full((3,), torch.inf).to(solution)
    for _ in range(rounds):
        pull = sum_pixels(residual)
        scaled = inverse * pull
        strength = (pull * scaled).sum(0)
        direction, before = scaled + strength / before * direction, strength.clamp_min(TINY)
        with torch.no_grad():
            change = draw(replace(fixed, color=fixed.color + direction)) - painted
        step = strength / change.square().sum((1, 2)).clamp_min(TINY)
        solution = solution + step * direction
        residual = residual - step[:, None, None] * change
    return replace(fixed, color=solution.clamp(0, 1))
