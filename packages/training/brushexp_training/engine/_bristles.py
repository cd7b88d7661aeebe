"""Simulate a brush's bristles with position-based dynamics (Mueller et al., 2007), in compiled code.

Arrays of vertices have the shape (V, N): each row holds the same vertex of all bristles, so that loops over bristles
become SIMD code. A window is `UNITS` units of length wide; z points up from the canvas; the time step is one frame.
"""

import numpy as np

from brushexp.contracts.kernels import function

F = np.float32
UNITS = F(256)  # width of a window in units, which are pixels of SPIRAL's canvas, as are its constants

VERTICES = 10
HEIGHT = F(2.0)  # height of the handle above the canvas, in brush scales
SEGMENT = F(0.5)  # rest length between two vertices, in brush scales
TOUCH = F(0.13333)  # height below which a bristle touches the canvas, in brush scales
SMALLEST_DISTANCE = F(0.01)  # lower bound of divisors (a constant of Fluid Paint, like the next two)
SHORT = F(1e-4)
FLAT = F(1e-4)


@function
def _pull(q, a, b, rest):  # type: ignore[no-untyped-def]
    """Constrain the distance between the vertices a and b of every bristle; the root does not move."""
    xa, ya, za, xb, yb, zb = q[0, a], q[1, a], q[2, a], q[0, b], q[1, b], q[2, b]
    share_a, share_b = (F(0), F(1)) if a == 0 else (F(0.5), F(0.5))
    for i in range(len(xa)):
        dx, dy, dz = xb[i] - xa[i], yb[i] - ya[i], zb[i] - za[i]
        d = np.sqrt(dx * dx + dy * dy + dz * dz)
        way = (d - rest) / max(d, SMALLEST_DISTANCE)
        xa[i] += share_a * way * dx
        ya[i] += share_a * way * dy
        za[i] += share_a * way * dz
        xb[i] -= share_b * way * dx
        yb[i] -= share_b * way * dy
        zb[i] -= share_b * way * dz


@function
def _straighten(q, a, stiffness):  # type: ignore[no-untyped-def]
    """Straighten every bristle at the vertices a, a + 1 and a + 2 if it is bent there by less than 90 degrees."""
    xa, ya, za = q[0, a], q[1, a], q[2, a]
    xb, yb, zb = q[0, a + 1], q[1, a + 1], q[2, a + 1]
    xc, yc, zc = q[0, a + 2], q[1, a + 2], q[2, a + 2]
    free = F(0) if a == 0 else F(1)
    for i in range(len(xa)):
        x1, y1, z1 = xb[i] - xa[i], yb[i] - ya[i], zb[i] - za[i]
        x2, y2, z2 = xc[i] - xb[i], yc[i] - yb[i], zc[i] - zb[i]
        over1 = F(1) / max(np.sqrt(x1 * x1 + y1 * y1 + z1 * z1), SHORT)
        over2 = F(1) / max(np.sqrt(x2 * x2 + y2 * y2 + z2 * z2), SHORT)
        x1, y1, z1 = x1 * over1, y1 * over1, z1 * over1
        x2, y2, z2 = x2 * over2, y2 * over2, z2 * over2
        dot = x1 * x2 + y1 * y2 + z1 * z2
        ax, ay, az = (dot * x1 - x2) * over1, (dot * y1 - y2) * over1, (dot * z1 - z2) * over1
        cx, cy, cz = (x1 - dot * x2) * over2, (y1 - dot * y2) * over2, (z1 - dot * z2) * over2
        bx, by, bz = -ax - cx, -ay - cy, -az - cz
        total = free * (ax * ax + ay * ay + az * az) + bx * bx + by * by + bz * bz + cx * cx + cy * cy + cz * cz
        way = stiffness[i] * (dot - F(1)) / max(total, FLAT)
        way = way if dot > F(0) else F(0)
        way_a = free * way
        xa[i] -= way_a * ax
        ya[i] -= way_a * ay
        za[i] -= way_a * az
        xb[i] -= way * bx
        yb[i] -= way * by
        zb[i] -= way * bz
        xc[i] -= way * cx
        yc[i] -= way * cy
        zc[i] -= way * cz


@function
def _constrain(q, rest, stiffness):  # type: ignore[no-untyped-def]
    """Apply one round of constraints, in passes whose constraints do not share any vertices."""
    for begin in range(2):
        for a in range(begin, VERTICES - 1, 2):
            _pull(q, a, a + 1, rest)
    for begin in range(3):
        for a in range(begin, VERTICES - 2, 3):
            _straighten(q, a, stiffness)
    for v in range(VERTICES):
        z = q[2, v]
        for i in range(len(z)):
            z[i] = z[i] if z[i] >= F(0) else F(0.5) * z[i]


@function
def move(p, velocity, before, q, roots, x, y, scale, stiffness, gravity, damping, iterations):  # type: ignore[no-untyped-def]
    """Move the brush by one frame, with its handle at (x, y, 2 scale), where ``scale`` is the radius of the brush.

    Updates the positions ``p`` (3, V, N) and the ``velocity`` per frame, and stores the old positions in ``before``;
    ``q`` is scratch space. ``roots`` (2, N) are in multiples of ``scale``; ``damping`` is the fraction of the velocity
    that is kept.
    """
    n = roots.shape[1]
    for axis in range(3):
        fall = gravity if axis == 2 else F(0)
        for v in range(VERTICES):
            old, speed, new, kept = p[axis, v], velocity[axis, v], q[axis, v], before[axis, v]
            for i in range(n):
                new[i] = old[i] + damping * speed[i] - fall
                kept[i] = old[i]
    for _ in range(iterations):
        for i in range(n):
            q[0, 0, i] = x + scale * roots[0, i]
            q[1, 0, i] = y + scale * roots[1, i]
            q[2, 0, i] = HEIGHT * scale
        _constrain(q, SEGMENT * scale, stiffness)
    for axis in range(3):
        for v in range(VERTICES):
            old, speed, new = p[axis, v], velocity[axis, v], q[axis, v]
            for i in range(n):
                speed[i] = new[i] - old[i]
                old[i] = new[i]


@function
def settle(begin, end, scales, roots, splay, stiffness, gravity, damping, iterations, frames, approach, out):  # type: ignore[no-untyped-def]
    """Let the brushes ``begin`` to ``end`` come to rest on the canvas, with their bristles trailing behind.

    Without this, a stroke would begin with a smear. A brush moves to the right by ``approach`` brush radii per frame
    for the first half of the ``frames``, and then stops. The brushes are given by their radii ``scales`` (B,), their
    ``roots`` (B, 2, N), and the ``stiffness`` (B, N) and ``splay`` (B, N) of their bristles, where ``splay`` is the
    direction in which a bristle falls. Positions relative to the handle, in brush radii, are written to ``out``
    (B, 3, V, N).
    """
    for b in range(begin, end):
        scale = scales[b]
        n = roots.shape[2]
        p = np.empty((3, VERTICES, n), F)
        velocity, before, q = np.zeros_like(p), np.empty_like(p), np.empty_like(p)
        for i in range(n):
            for v in range(VERTICES):  # down to the canvas, then along it, each in its own direction
                along = SEGMENT * F(v)
                beyond = max(along - HEIGHT, F(0))
                p[0, v, i] = scale * (roots[b, 0, i] + beyond * np.cos(splay[b, i]))
                p[1, v, i] = scale * (roots[b, 1, i] + beyond * np.sin(splay[b, i]))
                p[2, v, i] = scale * max(HEIGHT - along, F(0))
        for k in range(frames):
            x = -approach * scale * F(max(frames // 2 - k, 0))
            move(p, velocity, before, q, roots[b], x, F(0), scale, stiffness[b], gravity, damping, iterations)
        for axis in range(3):
            for v in range(VERTICES):
                for i in range(n):
                    out[b, axis, v, i] = p[axis, v, i] / scale
