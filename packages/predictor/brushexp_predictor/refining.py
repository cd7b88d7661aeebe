"""A few steps of gradient descent, as a painting takes them: what a start is worth to the optimiser."""

from collections.abc import Callable

import torch
from torch import Tensor

from brushexp.registry import build_named
from brushexp.strokes.catalogue import Catalogue, Strokes


def refined(strokes: Strokes, target: Tensor, draw: Callable[[Strokes], Tensor], steps: int) -> Strokes:
    """Move strokes by so many steps of the default optimiser towards a target (3, H, W); the order stays."""
    plan = build_named("optimizer", "torch", {"options": {"betas": [0.9, 0.95], "eps": 1e-15}})
    with torch.inference_mode(False), torch.enable_grad():  # a validation of Lightning forbids gradients
        catalogue, target = Catalogue(strokes.map(Tensor.clone), plan.units), target.clone()
        optimizer = plan.over(catalogue.parameters())
        for step in range(steps):
            for group in optimizer.param_groups:
                group["lr"] = plan.lr * plan.share(step / steps)
            optimizer.zero_grad()
            (draw(catalogue()) - target).square().mean().backward()
            optimizer.step()
            catalogue.keep_in_range()
        return catalogue().map(Tensor.detach)
