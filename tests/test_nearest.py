"""The searches for nearest points agree with bisection, wherever a stroke is within reach."""

import numpy as np
import torch

from brushexp.compat.compiled import function
from brushexp.compositing.nearest import find_nearest, recall_nearest
from brushexp.compositing.tile_lists import AREA, NEAREST, TILE, F
from brushexp.strokes.bezier import closest_parameter, point_at
from brushexp.system.runtime import share


@function
def search(begin, end, p, reach, corners, found, recalled):
    for i in range(begin, end):
        own, near = np.empty(2 * AREA, F), np.empty((1, AREA), np.uint16)
        ox, oy = corners[i, 0], corners[i, 1]
        find_nearest(p, i, reach[i], ox, oy, own, near, 0, True)
        found[i] = own[NEAREST * AREA :]
        recall_nearest(p, i, ox, oy, own, near, 0)
        recalled[i] = own[NEAREST * AREA :]


def random_tiles(n):
    """Curves (n, 3, 2), straight ones and hairpins, how far they reach (n,), and tiles (n, 2) not far from them."""
    generator = np.random.default_rng(0)
    length, reach = np.exp(generator.uniform(np.log([4, 1]), np.log([200, 40]), (n, 2))).T
    bend = length * np.exp(generator.uniform(np.log(0.05), np.log(6), n))
    chord, bend = (
        size[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        for size, angle in zip((length, bend), generator.uniform(0, 2 * np.pi, (2, n)), strict=True)
    )
    start = np.full((n, 2), 400.0)
    curve = np.stack([start, start + (chord - bend) / 2, start + chord], axis=1)
    t, angle = generator.uniform(0, [[1], [2 * np.pi]], (2, n))
    place = point_at(torch.from_numpy(curve), torch.from_numpy(t)).numpy()
    place += reach[:, None] * generator.uniform(0, 1, (n, 1)) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return curve.astype(F), reach.astype(F), (place // TILE * TILE).astype(F)


def test_the_distance_is_found_wherever_it_is_within_reach():
    curve, reach, corners = random_tiles(1000)
    found, recalled = np.empty((2, len(curve), AREA), F)
    share(search, len(curve), curve.reshape(-1, 6), reach, corners, found, recalled)
    y, x = np.divmod(np.arange(AREA), TILE)
    pixels = torch.from_numpy(corners[:, None] + np.stack([x, y], axis=1) + 0.5).double()
    curves = torch.from_numpy(curve).double()[:, None]
    exact = (point_at(curves, closest_parameter(curves, pixels)) - pixels).norm(dim=-1)
    within = exact <= torch.from_numpy(reach)[:, None]
    assert within.float().mean() > 0.3
    for t in (found, recalled):
        distance = (point_at(curves, torch.from_numpy(t).double()) - pixels).norm(dim=-1)
        assert (distance - exact)[within].max() < 1e-3
        assert (distance - exact).min() > -1e-3, "nothing comes nearer than it is"
