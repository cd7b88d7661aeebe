"""Measure the importance of each stroke for policies that add and remove strokes."""

from dataclasses import replace

import torch
from torch import Tensor

from brushexp.compositing.bands import cuts
from brushexp.painting.picture import Picture
from brushexp.strokes.catalogue import Strokes

PROBE_COUNT = 8  # random pictures for estimating a sum of squares, with a relative deviation of sqrt(2 / PROBE_COUNT)


@torch.no_grad()
def importance(strokes: Strokes, front_to_back: Tensor, picture: Picture, generator: torch.Generator) -> Tensor:
    """Measure how much the painting's squared error, weighted by the focus, grows when each of N strokes is removed.

    The picture P is linear in the opacity of each stroke with color=rgb, and nearly linear in other colour spaces.
    Removing a stroke changes the picture by d = -opacity * dP/dopacity, which changes the squared error by sum(d^2) + 2
    sum(error * d). Some blends compute both sums (`Blend.importance`). With other blends, a single backward pass gives
    the second sum for all strokes, and the square of sum(s * d) with random signs s is an unbiased estimate of the
    first (Hutchinson, 1990), so the result (N,) is noisy.
    """
    renderer, blend, background = picture.renderer, picture.blend, picture.background
    place = front_to_back.argsort()
    exact, probed = strokes.opacity.new_zeros(len(strokes)), strokes.opacity.new_zeros(PROBE_COUNT, len(strokes))
    for top, rows, number in cuts(strokes, picture.size, renderer):
        part, order = strokes[number].moved(shift=(0, -top)), place[number].argsort()
        size = (rows, picture.size[1])
        target = picture.target[:, top : top + rows].contiguous()
        weight = target.new_ones(size) if picture.focus is None else picture.focus[top : top + rows]
        growth = blend.importance(renderer(part), order, size, background, target, weight)
        if growth is not None:
            exact[number] += growth
            continue
        opacity = part.opacity.clone().requires_grad_()
        with torch.enable_grad():
            layers = renderer(replace(part, opacity=opacity))
            image = blend(layers, order, size, background).image
        if not image.requires_grad:
            continue
        signs = torch.randint(0, 2, (PROBE_COUNT, *image.shape), generator=generator).to(image) * 2 - 1
        for into, probe in zip(probed, weight.sqrt() * signs, strict=True):
            (slope,) = torch.autograd.grad(image, opacity, probe, retain_graph=True)
            into[number] += part.opacity * slope
        (slope,) = torch.autograd.grad(image, opacity, weight * (image.detach() - target))
        exact[number] -= 2 * part.opacity * slope
    return exact + probed.square().mean(0)
