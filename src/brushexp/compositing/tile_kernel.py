"""The compiled passes of a kind of layer, put together from its parts."""
# mypy: allow-untyped-defs

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from brushexp.compositing.nearest import find_nearest, keep_nearest, recall_nearest
from brushexp.compositing.passes import backward_pass, forward_pass, importance_pass
from brushexp.system.compiled import Compiled, inline


@inline
def _seek_nearest(p, i, ox, oy, own, near, j, keep):
    find_nearest(p, i, ox, oy, own)
    if keep:
        keep_nearest(own, near[j])


@inline
def _recall_nearest(p, i, ox, oy, own, near, j):
    recall_nearest(p, i, ox, oy, near[j], own)


@dataclass(frozen=True)
class TileKernel:
    """The compiled passes of one kind of layer, see `tile_kernel`.

    Attributes:
        columns: numbers that `pull` writes.
        curved: whether nearest points of curves are sought.
        forward: see there.
        backward: see there.
        importance: see there.
        gather: what becomes of the numbers that `pull` wrote, see `tile_kernel`; None for their sums.
    """

    columns: int
    curved: bool
    forward: Compiled
    backward: Compiled
    importance: Compiled
    gather: Callable[..., Any] | None


def tile_kernel(
    *,
    columns: int,
    rows: int,
    cover: Callable[..., Any],
    tint: Callable[..., Any],
    shade: Callable[..., Any],
    pull: Callable[..., Any],
    temporary: int = 1,
    curved: bool = True,
    gather: Callable[..., Any] | None = None,
) -> TileKernel:
    """Compiled passes from the parts of a kind of layer, which are functions marked by `system.compiled.inline`.

    Args:
        columns: numbers that `pull` writes.
        rows: of ``own``; row ABOVE is the skeleton's, and row NEAREST too if ``curved``.
        cover: see the function of that name, as for the next three.
        tint: constant numbers of a stroke.
        shade: a pixel.
        pull: gradient.
        temporary: rows for use within a part.
        curved: find nearest points first. The first six numbers of a stroke are then its control points in pixels,
            start, control and end, x and y each.
        gather: makes gradients of what `pull` wrote, called with pairs, there, row of the lists, order, gradient of the
            picture, strokes and data; None: they are summed by stroke and are the gradient of the strokes' numbers.
    """
    parts: dict[str, Any] = {"cover": cover, "tint": tint, "shade": shade, "ROWS": rows, "TEMPORARY": temporary}
    if curved:
        parts |= {"seek": _seek_nearest, "recall": _recall_nearest}
    back = backward_pass.having(**parts, pull=pull)
    return TileKernel(columns, curved, forward_pass.having(**parts), back, importance_pass.having(**parts), gather)
