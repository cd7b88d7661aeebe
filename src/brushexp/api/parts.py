"""``brushexp.list_plugins``, ``brushexp.create`` and ``brushexp.render``: list and build plugins, render strokes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from numbers import Integral
from typing import Any

import torch
from torch import Tensor

from brushexp.api.settings import load_choices, undisturbed
from brushexp.compat.transforms import inside_transform
from brushexp.errors import UserError
from brushexp.plugins.blend.base import Compositor
from brushexp.plugins.renderer.base import Renderer
from brushexp.registry import FAMILIES, build_named, plugins
from brushexp.strokes.catalogue import Strokes, check_strokes


def list_plugins(family: str | None = None) -> dict[str, dict[str, str]]:
    """Map each plugin family to its plugins and their one-line descriptions, including plugins in the current folder.

    >>> list(list_plugins("order")["order"])
    ['accuracy', 'area', 'fixed', 'lines']
    """
    load_choices()
    if family not in (None, *FAMILIES):
        raise UserError(f"there is no family {family}; choose one of {', '.join(FAMILIES)}")
    families = FAMILIES if family is None else [family]
    return {name: {plugin.name: plugin.summary for plugin in plugins(name)} for name in families}


def create(family: str, name: str, **options: Any) -> Any:
    """Build a plugin, such as a loss, renderer or exporter, with options named as on the command line.

    A renderer's weights are frozen, which makes rendering faster; call ``.requires_grad_()`` on it to train them.

    Raises:
        UserError: if an option is wrong, or if there is no plugin of the given name.

    >>> create("loss", "mse", weight=2.0).weight
    2.0
    """
    list_plugins(family)
    with undisturbed(gradients=False):
        built = build_named(family, name, options)
    return built.requires_grad_(False) if isinstance(built, Renderer) else built


def render(
    strokes: Strokes | Sequence[Strokes],
    size: int | tuple[int, int],
    *,
    depth: Tensor | Sequence[Tensor | None] | None = None,
    background: Tensor | None = None,
    renderer: str | Renderer = "analytic",
    blend: str = "tiled",
    color: str = "rgb",
    **options: Any,
) -> Tensor:
    """Render strokes on a canvas, differentiably with respect to their position, curve, width, color and opacity.

    Use ``.backward()`` or `torch.autograd.grad` for first derivatives; second derivatives need ``blend="dense"``.

    Args:
        strokes: N strokes, in canvas pixels; ``strokes.moved(zoom=2)`` scales them to a canvas twice as large. A list
            of B sets of strokes, which may differ in N, is a batch.
        size: height and width of the canvas in pixels, or one number for both.
        depth: (N,) ranks, 0 for the bottom stroke; None keeps the order of the strokes. For a batch, a list of B
            arrays.
        background: (3,) RGB of the bare canvas, in [0, 1]; None means white. For a batch, it may be (B, 3).
        renderer: name of a renderer, or a renderer built by `create`.
        blend: name of the blend that composites the strokes.
        color: name of the colour space in which the strokes are composited.
        options: options of the named renderer, such as ``soft=1.0``.

    Returns:
        (3, H, W) RGB in [0, 1]; for a batch, (B, 3, H, W).

    Raises:
        UserError: if an argument is wrong, or within a ``torch.func`` transform (vmap, grad), which cannot trace
            compiled code.

    >>> from brushexp.strokes.prior import sample_prior
    >>> strokes = sample_prior(4).moved(shift=(16, 12)).map(lambda value: value.requires_grad_())
    >>> picture = render(strokes, (24, 32))
    >>> picture.mean().backward()
    >>> picture.shape, strokes.position.grad.shape
    (torch.Size([3, 24, 32]), torch.Size([4, 2]))
    >>> render([strokes, strokes[:2]], (24, 32)).shape
    torch.Size([2, 3, 24, 32])
    """
    if inside_transform():
        cure = "call .backward() or torch.autograd.grad, and give a list of strokes for a batch"
        raise UserError(f"render does not work within torch.func (vmap, grad, jacrev); {cure}")
    is_one = isinstance(strokes, Strokes)
    canvases = [strokes] if isinstance(strokes, Strokes) else list(strokes)
    depths = _depths(depth, canvases, is_one=is_one)
    canvas = _canvas(size)
    if options and not isinstance(renderer, str):
        cure = "pass its options to brushexp.create, or pass its name here"
        raise UserError(f"{', '.join(options)}: this renderer is built already; {cure}")
    with undisturbed(gradients=False):
        grounds = _grounds(background, len(canvases), is_one=is_one)
        chosen = create("renderer", renderer, **options) if isinstance(renderer, str) else renderer
        compositor = Compositor(create("blend", blend), create("color", color))
        pictures = [_draw(*each, canvas, chosen, compositor) for each in zip(canvases, depths, grounds, strict=True)]
    return pictures[0] if is_one else torch.stack(pictures)


def _draw(
    strokes: Strokes,
    depth: Tensor | None,
    background: Tensor,
    canvas: tuple[int, int],
    renderer: Renderer,
    compositor: Compositor,
) -> Tensor:
    """Render the strokes of one canvas as a picture (3, H, W)."""
    order = torch.arange(len(strokes)) if depth is None else depth
    like = strokes.position
    front_to_back = order.to(like.device).argsort(descending=True)
    return compositor(renderer.to(like.device)(strokes), front_to_back, canvas, background.to(like)).image


def _depths(
    depth: Tensor | Sequence[Tensor | None] | None, canvases: Sequence[Strokes], *, is_one: bool
) -> Sequence[Tensor | None]:
    """Return the stroke ranks for each canvas; raise a UserError for invalid strokes or ranks."""
    if not canvases:
        raise UserError("strokes is an empty list; give at least one Strokes")
    for number, strokes in enumerate(canvases):
        if not isinstance(strokes, Strokes):
            raise UserError(f"strokes[{number}] is {type(strokes).__name__}; give Strokes, or a list of them")
        check_strokes(strokes)
    depths: list[Any] = [depth] if is_one else [None] * len(canvases) if depth is None else list(depth)
    if len(depths) != len(canvases):
        raise UserError(f"depth has {len(depths)} entries for {len(canvases)} canvases; give ranks for each, or None")
    for ranks, strokes in zip(depths, canvases, strict=True):
        if ranks is not None and ranks.shape != (len(strokes),):
            wrong = f"depth has shape {tuple(ranks.shape)}"
            raise UserError(f"{wrong}; give a rank for each of the {len(strokes)} strokes")
    return depths


def _grounds(background: Tensor | None, count: int, *, is_one: bool) -> Sequence[Tensor]:
    """Return the colour of each bare canvas; raise a UserError for wrong shapes."""
    ground = torch.ones(3) if background is None else background
    if ground.shape == (3,):
        return [ground] * count
    if is_one or ground.shape != (count, 3):
        wrong = f"background has shape {tuple(ground.shape)}"
        raise UserError(f"{wrong}; give red, green and blue in [0, 1]" + f", or ({count}, 3) of them" * (not is_one))
    return list(ground)


def _canvas(size: object) -> tuple[int, int]:
    """Return the height and width of a canvas; a single number sets both."""
    sides = (size, size) if isinstance(size, Integral) else size
    if not isinstance(sides, str) and isinstance(sides, Iterable):
        match [*sides]:
            case [Integral() as height, Integral() as width] if min(int(height), int(width)) >= 1:
                return int(height), int(width)
    raise UserError(f"size={size} is not a canvas size; give height and width in pixels, (128, 256), or 128 for both")
