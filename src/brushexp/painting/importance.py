"""What each stroke contributes to a painting."""

from dataclasses import replace

import torch
from torch import Tensor

from brushexp.compositing.bands import cuts
from brushexp.plugins.blend.base import Blend
from brushexp.plugins.renderer.base import Renderer
from brushexp.strokes.catalogue import Strokes

PROBE_COUNT = 8  # random pictures that estimate a sum of squares: its relative deviation is sqrt(2 / PROBE_COUNT)


@torch.no_grad()
def importance(
    strokes: Strokes,
    front_to_back: Tensor,
    target: Tensor,
    focus: Tensor | None,
    background: Tensor,
    renderer: Renderer,
    blend: Blend,
    generator: torch.Generator,
) -> Tensor:
    """By how much the squared error of the painting would grow without each stroke.

    The picture is linear in the opacity of each stroke, so without one it changes by d = -opacity * dP/dopacity, and
    the squared error by sum(d^2) + 2 sum(error * d). A blend may know both sums (`Blend.importance`). If not, the
    second is one backward pass for all strokes, and the first is estimated without bias by the square of sum(s * d) for
    random signs s (Hutchinson, 1990), so the numbers scatter.

    Args:
        strokes: N strokes.
        front_to_back: (N,) their indices, the uppermost first.
        target: (3, H, W) in [0, 1].
        focus: (H, W) how much each pixel counts; None for all alike.
        background: (3,) colour of the bare canvas.
        renderer: draws the strokes.
        blend: lays them over each other.
        generator: of the signs.

    Returns:
        (N,) squared error, summed over pixels and channels; about 0 for a stroke that cannot be seen, negative for one
        that does harm.
    """
    height, width = target.shape[1:]
    place = torch.empty_like(front_to_back)
    place[front_to_back] = torch.arange(len(place), device=place.device)
    exact, probed = strokes.opacity.new_zeros(len(strokes)), strokes.opacity.new_zeros(PROBE_COUNT, len(strokes))
    for top, rows, number in cuts(strokes, (height, width), renderer):
        part, order, size = strokes[number].moved(shift=(0, -top)), place[number].argsort(), (rows, width)
        aim = target[:, top : top + rows].contiguous()
        weight = aim.new_ones(rows, width) if focus is None else focus[top : top + rows]
        known = blend.importance(renderer(part, number), order, size, background, aim, weight)
        if known is not None:
            exact[number] += known
            continue
        opacity = part.opacity.clone().requires_grad_()
        with torch.enable_grad():
            image = blend(renderer(replace(part, opacity=opacity), number), order, size, background).image
        if not image.requires_grad:
            continue
        signs = torch.randint(0, 2, (PROBE_COUNT, *image.shape), generator=generator).to(image) * 2 - 1
        for into, probe in zip(probed, weight.sqrt() * signs, strict=True):
            (slope,) = torch.autograd.grad(image, opacity, probe, retain_graph=True)
            into[number] += part.opacity * slope
        (slope,) = torch.autograd.grad(image, opacity, weight * (image.detach() - aim))
        exact[number] -= 2 * part.opacity * slope
    return exact + probed.square().mean(0)
