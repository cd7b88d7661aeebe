"""The colours that suit strokes best where they lie: least squares, for a painting is linear in its colours."""

from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor

from brushexp.strokes.catalogue import Strokes

Paint = Callable[[Strokes], Tensor]  # strokes on the canvas that is meant -> picture (3, H, W)


def best_colors(strokes: Strokes, target: Tensor, draw: Paint, rounds: int) -> Strokes:
    """Bring the colours of strokes near those of least squared error, by conjugate gradients (Hestenes, Stiefel, 1952).

    Each round draws the strokes once, and costs about as much as a step of gradient descent. Rounds are preconditioned
    by what is seen of each stroke. Colours are clamped to [0, 1] at the end.

    Args:
        strokes: N, whose forms stay.
        target: (3, H, W).
        draw: what draws strokes; linear in their colours but for the background.
        rounds: 4 come close.
    """
    fixed = strokes.map(Tensor.detach)

    def drawn(color: Tensor) -> tuple[Tensor, Tensor]:
        color = color.detach().requires_grad_()
        with torch.enable_grad():
            return color, draw(replace(fixed, color=color))

    color, picture = drawn(fixed.color)
    bare = draw(replace(fixed, color=torch.zeros_like(fixed.color))).detach()
    residual = target - picture.detach()
    (pull,) = torch.autograd.grad(picture, color, residual, retain_graph=True)
    (seen,) = torch.autograd.grad(picture, color, picture.detach().new_ones(picture.shape))
    inverse = 1 / seen.clamp_min(1e-3)
    solution, scaled = color.detach(), inverse * pull
    direction, strength = scaled, (pull * scaled).sum(0)
    for _ in range(rounds):
        ahead, picture = drawn(direction)
        change = picture.detach() - bare
        step = strength / change.square().sum((1, 2)).clamp_min(1e-12)
        solution = solution + step * direction
        residual = residual - step[:, None, None] * change
        (pull,) = torch.autograd.grad(picture, ahead, residual)
        scaled = inverse * pull
        following = (pull * scaled).sum(0)
        direction, strength = scaled + following / strength.clamp_min(1e-12) * direction, following
    return replace(fixed, color=solution.clamp(0, 1))
