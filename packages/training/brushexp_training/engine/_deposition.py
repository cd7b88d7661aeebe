"""Deposit the bristles' paint on the canvas, and let it flow while it is wet, in compiled code.

Grids are flat row-major arrays with a margin of one cell around the canvas, so that no index is out of bounds.
"""

import numpy as np

from brushexp.contracts.kernels import function, inline
from brushexp_training.engine._bristles import TOUCH, UNITS, VERTICES, F, move
from brushexp_training.engine._lit_paint import picture

FLOW = F(100 / 60)  # distance that paint moves per frame and unit of velocity, in units
LAG = F(2.2)  # frames by which the touching parts lag behind the handle, measured on straight strokes
SPLAT = F(0.05)  # radius of a splat, in brush scales
FASTEST = F(2)  # maximum velocity of a splat
MOST_SPLATS = 8  # maximum number per segment of a bristle, as in Fluid Paint; fewer where they would fall into one cell


@inline
def _at(a):  # type: ignore[no-untyped-def]
    """Convert an index to an unsigned integer, which lets the compiler turn loops into SIMD code."""
    return np.uint64(a)


@inline
def _deposit(grid, side, ix, iy, fx, fy, paint, push_x, push_y):  # type: ignore[no-untyped-def]
    """Distribute paint and momentum among the four cells around a point.

    The point is at the offset (fx, fy) from the cell (ix, iy).
    """
    at = _at(iy * side + ix)
    for corner in range(4):
        wx = fx if corner & 1 else F(1) - fx
        wy = fy if corner & 2 else F(1) - fy
        place = at + _at((corner & 1) + (corner >> 1) * side)
        grid[0, place] += wx * wy * paint
        grid[1, place] += wx * wy * push_x
        grid[2, place] += wx * wy * push_y


@function
def _splat(p, before, velocity, scale, opacity, drag, side, grid, area):  # type: ignore[no-untyped-def]
    """Add up the splats of one frame: capsules swept by the parts of the bristles that touch the canvas.

    Each capsule's paint and momentum are spread evenly along its path, and at each point among the four nearest cells,
    so that both are conserved however thin the capsule is; the source draws capsules pixel by pixel and loses paint
    between pixels. The sums of opacity * weight and of both velocity components are added to ``grid`` (3, side * side),
    whose rows have ``side`` cells including the margin. ``area`` (4,), which holds the top, bottom, left and right of
    the painted area, is enlarged where necessary.
    """
    cells = F(side - 2)
    fine = cells / UNITS  # cells per unit
    radius, touch = SPLAT * scale, TOUCH * scale
    limit = cells - F(0.001)
    top, bottom, left, right = area[0], area[1], area[2], area[3]
    for v in range(VERTICES - 1):
        for i in range(p.shape[2]):
            za, zb = p[2, v, i], p[2, v + 1, i]
            if min(za, zb) > touch:
                continue
            ax, ay, bx, by = p[0, v, i], p[1, v, i], p[0, v + 1, i], p[1, v + 1, i]
            oax, oay, obx, oby = before[0, v, i], before[1, v, i], before[0, v + 1, i], before[1, v + 1, i]
            extent = fine * np.sqrt((bx - ax) * (bx - ax) + (by - ay) * (by - ay))
            count = min(max(int(F(1.5) * extent + F(1)), 1), MOST_SPLATS)
            share = F(MOST_SPLATS) / F(count)
            for j in range(count):
                t = (F(j) + F(0.5)) / F(count)
                if za + t * (zb - za) > touch:
                    continue
                x, y = ax + t * (bx - ax), ay + t * (by - ay)
                ox, oy = oax + t * (obx - oax), oay + t * (oby - oay)
                way = np.sqrt((x - ox) * (x - ox) + (y - oy) * (y - oy))
                vx = velocity[0, v, i] + t * (velocity[0, v + 1, i] - velocity[0, v, i])
                vy = velocity[1, v, i] + t * (velocity[1, v + 1, i] - velocity[1, v, i])
                vx, vy = drag * vx, drag * vy
                slow = min(F(1), FASTEST / max(np.sqrt(vx * vx + vy * vy), F(1e-6)))
                steps = min(int(fine * way) + 1, 2 * side)
                part = share * fine * fine / F(steps)
                paint = part * opacity * radius * (way + F(1.0471976) * radius)
                push = part * (way + F(2) * radius) * F(2) * radius * slow
                for k in range(steps):
                    s = (F(k) + F(0.5)) / F(steps)
                    gx, gy = fine * (ox + s * (x - ox)) + F(0.5), fine * (oy + s * (y - oy)) + F(0.5)
                    if F(0) < gx < limit and F(0) < gy < limit:
                        ix, iy = int(gx), int(gy)
                        top, bottom, left, right = min(top, iy), max(bottom, iy + 1), min(left, ix), max(right, ix + 1)
                        _deposit(grid, side, ix, iy, gx - F(ix), gy - F(iy), paint, push * vx, push * vy)
    area[0], area[1], area[2], area[3] = top, bottom, left, right


@function
def _widen(grid, scratch, side, area, radius):  # type: ignore[no-untyped-def]
    """Blur a frame's splats in ``grid`` (3, side * side) with a triangular kernel of ``radius`` cells along each axis.

    Distributing a splat among four cells already acts as such a kernel of radius 1. The variances of successive kernels
    add up, so the remaining blur is correspondingly narrower. ``area`` is enlarged by the blur's reach.
    """
    wide = np.sqrt(max(radius * radius - F(1), F(0)))
    reach = int(np.ceil(wide)) - 1
    if reach < 1:
        return
    weight = np.empty(reach + 1, F)
    for k in range(reach + 1):
        weight[k] = F(1) - F(k) / wide
    weight /= F(2) * weight.sum() - weight[0]
    area[0], area[1] = max(area[0] - reach, 1), min(area[1] + reach, side - 2)
    area[2], area[3] = max(area[2] - reach, 1), min(area[3] + reach, side - 2)
    for step, low, high in ((1, area[2], area[3]), (side, area[0], area[1])):
        for c in range(3):
            for y in range(area[0], area[1] + 1):
                for x in range(area[2], area[3] + 1):
                    q, place = y * side + x, x if step == 1 else y
                    total = weight[0] * grid[c, q]
                    for k in range(1, reach + 1):
                        total += weight[k] * grid[c, q - k * step] if place - k >= low else F(0)
                        total += weight[k] * grid[c, q + k * step] if place + k <= high else F(0)
                    scratch[c, q] = total
            for y in range(area[0], area[1] + 1):
                begin, end = y * side + area[2], y * side + area[3] + 1
                grid[c, begin:end] = scratch[c, begin:end]


@function
def _lay(grid, state, side, area):  # type: ignore[no-untyped-def]
    """Add a frame's splats from ``grid`` to the canvas.

    The coverage c becomes 1 - (1 - c) exp(-sum); height and velocity are increased.
    """
    u, v, cover, height = state[0], state[1], state[2], state[3]
    for y in range(area[0], area[1] + 1):
        for x in range(area[2], area[3] + 1):
            q = _at(y * side + x)
            cover[q] = F(1) - (F(1) - cover[q]) * np.exp(-grid[0, q])
            height[q] += grid[0, q]
            u[q] += grid[1, q]
            v[q] += grid[2, q]
            for c in range(3):
                grid[c, q] = F(0)


@function
def _project(state, pressure, side, area, rounds):  # type: ignore[no-untyped-def]
    """Make the flow approximately divergence-free by Jacobi iterations that start from zero pressure."""
    u, v, divergence, now, new = state[0], state[1], pressure[0], pressure[1], pressure[2]
    top, bottom, left, right = area[0], area[1], area[2], area[3]
    for y in range(top, bottom + 1):
        for x in range(left, right + 1):
            q = _at(y * side + x)
            divergence[q] = F(0.5) * (u[q + _at(1)] - u[q - _at(1)] + v[q + _at(side)] - v[q - _at(side)])
            now[q] = F(0)
    for _ in range(rounds):
        for y in range(top, bottom + 1):
            for x in range(left, right + 1):
                q = _at(y * side + x)
                near = now[q - _at(1)] + now[q + _at(1)] + now[q - _at(side)] + now[q + _at(side)]
                new[q] = F(0.25) * (near - divergence[q])
        now, new = new, now
    for y in range(top, bottom + 1):
        for x in range(left, right + 1):
            q = _at(y * side + x)
            u[q] -= F(0.5) * (now[q + _at(1)] - now[q - _at(1)])
            v[q] -= F(0.5) * (now[q + _at(side)] - now[q - _at(side)])


@inline
def _corners(x, y, side):  # type: ignore[no-untyped-def]
    """Return the cell above and to the left of a point, and the weights of the four surrounding cells."""
    ix, iy = np.int32(x), np.int32(y)
    fx, fy = x - F(ix), y - F(iy)
    first = _at(iy * np.int32(side) + ix)
    return first, (F(1) - fx) * (F(1) - fy), fx * (F(1) - fy), (F(1) - fx) * fy, fx * fy


@inline
def _mean(field, a, side, w0, w1, w2, w3):  # type: ignore[no-untyped-def]
    return w0 * field[a] + w1 * field[a + _at(1)] + w2 * field[a + _at(side)] + w3 * field[a + _at(side + 1)]


@function
def _advect(state, new, side, area, fluidity):  # type: ignore[no-untyped-def]
    """Advect paint and velocity by a backward midpoint rule with bilinear interpolation."""
    u, v, cover, height = state[0], state[1], state[2], state[3]
    new_u, new_v, new_cover, new_height = new[0], new[1], new[2], new[3]
    dt = FLOW * F(side - 2) / UNITS
    low, high = F(1), F(side - 2) - F(0.001)
    for y in range(area[0], area[1] + 1):
        for x in range(area[2], area[3] + 1):
            q = _at(y * side + x)
            hx = min(max(F(x) - F(0.5) * dt * u[q], low), high)
            hy = min(max(F(y) - F(0.5) * dt * v[q], low), high)
            a, w0, w1, w2, w3 = _corners(hx, hy, side)
            hx = min(max(F(x) - dt * _mean(u, a, side, w0, w1, w2, w3), low), high)
            hy = min(max(F(y) - dt * _mean(v, a, side, w0, w1, w2, w3), low), high)
            a, w0, w1, w2, w3 = _corners(hx, hy, side)
            new_u[q] = fluidity * _mean(u, a, side, w0, w1, w2, w3)
            new_v[q] = fluidity * _mean(v, a, side, w0, w1, w2, w3)
            new_cover[q] = _mean(cover, a, side, w0, w1, w2, w3)
            new_height[q] = _mean(height, a, side, w0, w1, w2, w3)


@function
def _set_down(curve, scale, hind, pose, roots, p, turned):  # type: ignore[no-untyped-def]
    """Place a settled brush at the start of a curve, facing in the direction of the curve.

    The bristles' positions are written to ``p``, and their roots to ``turned``.
    """
    cosine, sine = _tangent(curve, F(0))
    x, y = curve[0] + hind * cosine, curve[1] + hind * sine
    for i in range(roots.shape[1]):
        turned[0, i] = cosine * roots[0, i] - sine * roots[1, i]
        turned[1, i] = sine * roots[0, i] + cosine * roots[1, i]
        for v in range(VERTICES):
            p[0, v, i] = x + scale * (cosine * pose[0, v, i] - sine * pose[1, v, i])
            p[1, v, i] = y + scale * (sine * pose[0, v, i] + cosine * pose[1, v, i])
            p[2, v, i] = scale * pose[2, v, i]


@function
def _handle(curve, t, hind, fore):  # type: ignore[no-untyped-def]
    """Return the handle's position at t, as far ahead of the curve as the bristles trail behind the handle."""
    w = F(1) - t
    x = w * w * curve[0] + F(2) * t * w * curve[2] + t * t * curve[4]
    y = w * w * curve[1] + F(2) * t * w * curve[3] + t * t * curve[5]
    lead = hind + (fore - hind) * t
    dx, dy = _tangent(curve, t)
    return x + lead * dx, y + lead * dy


@function
def _tangent(curve, t):  # type: ignore[no-untyped-def]
    """Return the unit tangent at t.

    Where the velocity is 0, this is the direction of the chord or, without a chord, the direction to the right.
    """
    sx, sy, cx, cy, ex, ey = curve[0], curve[1], curve[2], curve[3], curve[4], curve[5]
    w = F(1) - t
    dx, dy = w * (cx - sx) + t * (ex - cx), w * (cy - sy) + t * (ey - cy)
    length = np.sqrt(dx * dx + dy * dy)
    if length < F(1e-3):
        dx, dy = ex - sx, ey - sy
        length = np.sqrt(dx * dx + dy * dy)
    return (dx / length, dy / length) if length > F(1e-3) else (F(1), F(0))


@function
def draw(  # type: ignore[no-untyped-def]
    begin, end, strokes, brush, first_pose, poses, reach, roots, stiffness, physics, counts, projection, images, heights
):
    """Paint strokes ``begin`` to ``end``, each on its own canvas, and write ``images`` and ``heights``.

    ``images`` is (n, 4, S, S), and ``heights`` is (n, S, S).

    ``strokes`` (n, 10) contains start, control and end (x and y in units), the radius of the brush, red, green and
    blue. ``brush`` (n,) is the index of each stroke's brush, whose bristles are in ``roots`` (., 2, N) and
    ``stiffness`` (., N). ``first_pose`` (n,) is the index of its initial pose among the ``poses`` (B, 3, V, N) from
    `settle`. For each pose, ``reach`` (B, 2) holds the distances behind the handle, in brush radii, at which the
    hindmost and the foremost part of the brush touch the canvas.
    """
    gravity, damping, opacity, drag, fluidity, relief = physics
    frames, iterations, rounds, fine, after = counts
    side = images.shape[2] * fine + 2
    for m in range(begin, end):
        curve, scale, color, which = strokes[m, :6], strokes[m, 6], strokes[m, 7:10], brush[m]
        hind, fore = reach[first_pose[m], 0] * scale, reach[first_pose[m], 1] * scale
        p, turned = np.empty((3, VERTICES, roots.shape[2]), F), np.empty((2, roots.shape[2]), F)
        velocity, before, q = np.zeros_like(p), np.empty_like(p), np.empty_like(p)
        _set_down(curve, scale, hind, poses[first_pose[m]], roots[which], p, turned)
        state, new = np.zeros((4, side * side), F), np.zeros((4, side * side), F)
        grid, pressure = np.zeros((3, side * side), F), np.zeros((3, side * side), F)
        wet = np.empty(4, np.int64)  # area of present and future paint
        wet[0], wet[1], wet[2], wet[3] = side, -1, side, -1
        for k in range(frames + after):
            if k < frames:
                x, y = _handle(curve, F(k + 1) / F(frames) * (F(1) + LAG / F(frames)), hind, fore)
                move(p, velocity, before, q, turned, x, y, scale, stiffness[which], gravity, damping, iterations)
                _splat(p, before, velocity, scale, opacity, drag, side, grid, wet)
            if wet[1] < 0:
                continue
            if k < frames:
                _widen(grid, pressure, side, wet, SPLAT * scale * F(side - 2) / UNITS)
                _lay(grid, state, side, wet)
            wet[0], wet[1] = max(wet[0] - 2, 1), min(wet[1] + 2, side - 2)
            wet[2], wet[3] = max(wet[2] - 2, 1), min(wet[3] + 2, side - 2)
            if projection:
                _project(state, pressure, side, wet, rounds)
            _advect(state, new, side, wet, fluidity)
            for row in range(wet[0], wet[1] + 1):
                begin, end = row * side + wet[2], row * side + wet[3] + 1
                for c in range(4):
                    state[c, begin:end] = new[c, begin:end]
        picture(state, side, fine, color, relief, images[m], heights[m])
