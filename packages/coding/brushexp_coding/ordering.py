"""Order strokes so that consecutive strokes are neighbours, without changing the picture."""

from collections.abc import Iterator

import numpy as np
from torch import linspace, tensor

from brushexp.contracts.families import Renderer
from brushexp.contracts.strokes import Strokes, curve_of, point_at

CELL = 4  # side of a cell in pixels
PIECES = 16  # number of pieces whose ends represent a curve
CHOICES = 1024  # maximum number of strokes among which the nearest is chosen


def neighbouring_order(strokes: Strokes, size: tuple[int, int], renderer: Renderer) -> np.ndarray:
    """Find an order (N,) of strokes, bottom to top, in which most strokes follow a nearby stroke.

    Strokes that may touch the same cell of the canvas (H, W) keep their order. Other strokes may be reordered, because
    the order of two strokes has no effect if no pixel shows both of them.
    """
    middle = point_at(curve_of(strokes).double(), tensor(0.5).double()).numpy()
    waits, followers = _constraints(strokes, size, renderer)
    free = [stroke for stroke in range(len(strokes)) if not waits[stroke]]
    order, here = np.empty(len(strokes), np.int64), np.zeros(2)
    for place in range(len(strokes)):
        away = middle[free[:CHOICES]] - here
        stroke = free.pop(int((away * away).sum(1).argmin()))
        order[place], here = stroke, middle[stroke]
        for follower in followers[stroke]:
            waits[follower] -= 1
            if not waits[follower]:
                free.append(follower)
    return order


def _constraints(strokes: Strokes, size: tuple[int, int], renderer: Renderer) -> tuple[list[int], list[list[int]]]:
    """Count the strokes directly below each stroke in any cell, and list the strokes directly above it."""
    top: dict[int, int] = {}
    waits, followers = [0] * len(strokes), [list[int]() for _ in range(len(strokes))]
    for stroke, cells in enumerate(touched_cells(strokes, size, renderer)):
        below = {top[cell] for cell in cells if cell in top}
        waits[stroke] = len(below)
        for other in below:
            followers[other].append(stroke)
        top.update(dict.fromkeys(cells, stroke))
    return waits, followers


def touched_cells(strokes: Strokes, size: tuple[int, int], renderer: Renderer) -> Iterator[list[int]]:
    """Yield, for each stroke, all cells of the canvas (H, W) that it touches, and possibly a few more."""
    layers = renderer(strokes)
    curve = layers.curve.detach().double()
    points = point_at(curve[:, None], linspace(0, 1, PIECES + 1).double()[None]).numpy()  # (N, PIECES + 1, 2)
    between = np.linalg.norm(np.diff(points, axis=1), axis=2).max(1) / 2  # maximum distance of a piece from its ends
    bend = np.linalg.norm((curve[:, 0] - 2 * curve[:, 1] + curve[:, 2]).numpy(), axis=1)
    reach = layers.reach.detach().double().numpy() + between + bend / (4 * PIECES**2) + CELL / np.sqrt(2)
    columns, rows = -(-size[1] // CELL), -(-size[0] // CELL)
    limits = np.array([columns, rows])
    first = np.floor((points.min(1) - reach[:, None]) / CELL).clip(0, limits).astype(int)
    last = np.ceil((points.max(1) + reach[:, None]) / CELL).clip(0, limits).astype(int)
    for path, far, (left, up), (right, down) in zip(points, reach, first, last, strict=True):
        x, y = (np.arange(left, right) + 0.5) * CELL, (np.arange(up, down) + 0.5) * CELL
        across = (x[:, None] - path[:, 0]) ** 2
        along = (y[:, None] - path[:, 1]) ** 2
        nearest = (along[:, None] + across[None]).min(2, initial=np.inf)
        row, column = np.nonzero(nearest <= far * far)
        yield ((row + up) * columns + column + left).tolist()
