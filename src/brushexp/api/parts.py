"""``brushexp.list_plugins``, ``brushexp.create`` and ``brushexp.render``: plugins, and strokes that they draw."""

from __future__ import annotations

from collections.abc import Iterable
from numbers import Integral
from typing import Any

import torch
from torch import Tensor

from brushexp.api.settings import load, undisturbed
from brushexp.errors import UserError
from brushexp.plugins.blend.base import Compositor
from brushexp.plugins.renderer.base import Renderer
from brushexp.registry import FAMILIES, build_named, plugins
from brushexp.strokes.catalogue import Strokes, check_strokes


def list_plugins(family: str | None = None) -> dict[str, dict[str, str]]:
    """Map families to the names of their plugins, those of the current folder too, and to a line about each.

    >>> list(list_plugins("order")["order"])
    ['accuracy', 'area', 'fixed']
    """
    load()
    if family not in (None, *FAMILIES):
        raise UserError(f"there is no family {family}; choose one of {', '.join(FAMILIES)}")
    families = FAMILIES if family is None else [family]
    return {name: {plugin.name: plugin.summary for plugin in plugins(name)} for name in families}


def create(family: str, name: str, **options: Any) -> Any:
    """Build one plugin with options as its keys have them: a loss, a renderer, an exporter.

    The weights of a renderer are frozen, and so it draws fast; ``.requires_grad_()`` on it is for training them.

    Raises:
        UserError: which option does not fit, or which names there are.

    >>> create("loss", "mse", weight=2.0).weight
    2.0
    """
    list_plugins(family)
    with undisturbed(gradients=False):
        built = build_named(family, name, options)
    return built.requires_grad_(False) if isinstance(built, Renderer) else built


def render(
    strokes: Strokes,
    size: int | tuple[int, int],
    *,
    depth: Tensor | None = None,
    background: Tensor | None = None,
    renderer: str | Renderer = "analytic",
    blend: str = "tiled",
    color: str = "rgb",
    **options: Any,
) -> Tensor:
    """Draw strokes on a canvas; gradients flow back into their position, curve, width, color and opacity.

    Args:
        strokes: N, in pixels of the canvas; ``strokes.moved(zoom=2)`` are those of one twice as large.
        size: height and width of the canvas in pixels; one number is both.
        depth: (N,) ranks, 0 for the bottom stroke; None lays them in their order.
        background: (3,) RGB in [0, 1] of the bare canvas; None is white.
        renderer: a name, or a renderer of `create`.
        blend: name of what lays them over each other.
        color: name of the space in which they mix.
        options: options of a renderer by name, such as ``soft=1.0``.

    Returns:
        (3, H, W) RGB in [0, 1].

    >>> from brushexp.strokes.prior import sample_prior
    >>> strokes = sample_prior(4).moved(shift=(16, 12)).map(lambda value: value.requires_grad_())
    >>> picture = render(strokes, (24, 32))
    >>> picture.mean().backward()
    >>> picture.shape, strokes.position.grad.shape
    (torch.Size([3, 24, 32]), torch.Size([4, 2]))
    """
    check_strokes(strokes)
    canvas = _canvas(size)
    if depth is not None and depth.shape != (len(strokes),):
        raise UserError(f"depth has shape {tuple(depth.shape)}; give a rank for each of the {len(strokes)} strokes")
    if background is not None and background.shape != (3,):
        raise UserError(f"background has shape {tuple(background.shape)}; give red, green and blue in [0, 1]")
    if options and not isinstance(renderer, str):
        raise UserError(f"{', '.join(options)} would be options of a renderer that is made already; give its name")
    with undisturbed(gradients=False):
        order = torch.arange(len(strokes)) if depth is None else depth
        chosen = create("renderer", renderer, **options) if isinstance(renderer, str) else renderer
        paper = torch.ones(3) if background is None else background
        like = strokes.position
        front_to_back = order.to(like.device).argsort(descending=True)
        compositor = Compositor(create("blend", blend), create("color", color))
        return compositor(chosen.to(like.device)(strokes), front_to_back, canvas, paper.to(like)).image


def _canvas(size: object) -> tuple[int, int]:
    """Read height and width; one number is both."""
    sides = (size, size) if isinstance(size, Integral) else size
    if not isinstance(sides, str) and isinstance(sides, Iterable):
        match [*sides]:
            case [Integral() as height, Integral() as width] if min(int(height), int(width)) >= 1:
                return int(height), int(width)
    raise UserError(f"size={size} is no canvas; give height and width in pixels, (128, 256), or 128 for a square")
