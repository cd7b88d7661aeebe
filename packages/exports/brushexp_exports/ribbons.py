"""Convert strokes to 3-D ribbons of paint: stacked grids of points along and across each stroke."""

from dataclasses import dataclass

import numpy as np
import torch

from brushexp.contracts.families import ExportJob
from brushexp.contracts.members import profile_of, soft_edge
from brushexp.contracts.strokes import point_at

BODY, CAPS, ACROSS = 9, 3, 3  # sections of a ribbon on its curve, and of each round end; points of a section
SECTIONS = BODY + 2 * CAPS
POINTS = SECTIONS * ACROSS
TRIANGLES = 2 * (SECTIONS - 1) * (ACROSS - 1)
CELLS = 256  # grid cells along the longer side, used to find overlapping strokes
EDGE_HEIGHT = 0.3  # height of a ribbon's edges above the paint below, in thicknesses; its middle is 1 above
Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Ribbons:
    """The N visible strokes, bottom to top, as grids of S x A points in pixels, with y up and z towards the viewer.

    Each grid has S sections of A points. The origin is the centre of the canvas, which is in the plane z = 0.
    """

    number: Array  # (N,) rank of each stroke, counted from the bottom
    points: Array  # (N, S, A, 3) from the start of a stroke to its end, and from its right to its left
    normals: Array  # (N, S, A, 3) unit vectors, upwards
    along: Array  # (S,) from 0 at the start to 1 at the end
    color: Array  # (N, S, 3) display-referred RGB in [0, 1]
    opacity: Array  # (N,)
    width: Array  # (N, S) thickness of the stroke in pixels


@torch.no_grad()
def ribbons_of(job: ExportJob, thickness: float) -> Ribbons:
    """Stack strokes as ribbons that are ``thickness`` pixels high in the middle and clipped to the canvas."""
    profile, _ = profile_of(job)
    order = job.bottom_up.cpu()
    rows = {name: getattr(profile, name).detach().cpu()[order].double() for name in profile.per_stroke}
    half, _, opacity = soft_edge(rows["half_width"], rows["opacity"], profile.soft + rows["softness"], 1)
    t = torch.linspace(0, 1, BODY, dtype=torch.float64).expand(len(order), -1)
    u = 2 * t - 1
    wide = half[:, None] * (1 - profile.taper * u**2) * (1 + rows["widening"][:, None] * u)
    around = u[:, np.arange(-CAPS, BODY + CAPS).clip(0, BODY - 1), None]
    color = rows["color"][:, None] + rows["drift"][:, None] * around
    middle, wide, left = _with_ends(rows["curve"], t, wide.clamp_min(0))
    flat = middle[:, :, None] + torch.linspace(-1, 1, ACROSS)[:, None] * (wide[..., None] * left)[:, :, None]
    size = flat.new_tensor(job.size[::-1])
    low, high = flat.amin((1, 2)), flat.amax((1, 2))
    seen = (wide.amax(1) > 0) & (opacity[:, 0] > 0) & (high > 0).all(1) & (low < size).all(1)
    flat = flat[seen].clamp_min(0).minimum(size)
    level = _levels(flat.numpy(), job.size)
    height = (level[:, None] + np.array([EDGE_HEIGHT, 1.0, EDGE_HEIGHT])) * thickness
    flat = (flat - size / 2) * flat.new_tensor([1, -1])
    points = np.concatenate([flat.numpy(), np.broadcast_to(height[:, None, :, None], (*flat.shape[:3], 1))], axis=3)
    kept = seen.numpy()
    return Ribbons(
        number=np.flatnonzero(kept),
        points=points,
        normals=_normals(points),
        along=np.linspace(0, 1, SECTIONS),
        color=color.numpy()[kept],
        opacity=opacity[:, 0].numpy()[kept],
        width=2 * wide.numpy()[kept],
    )


def _with_ends(curve: torch.Tensor, t: torch.Tensor, half: torch.Tensor) -> tuple[torch.Tensor, ...]:
    """Add round ends; return each section's centre (N, S, 2), half width (N, S) and leftward direction (N, S, 2)."""
    middle = point_at(curve[:, None], t)
    start, control, end = (point[:, None] for point in curve.unbind(1))
    beside = t.clamp(1e-4, 1 - 1e-4)[..., None]
    heading = (1 - beside) * (control - start) + beside * (end - control)
    length = heading.norm(dim=-1, keepdim=True)
    heading = torch.where(length > 0, heading / length.clamp_min(1e-12), heading.new_tensor([1.0, 0.0]))
    angle = torch.linspace(0.5, 0, CAPS + 1, dtype=torch.float64)[1:].flip(0) * np.pi * 0.9 + 0.05 * np.pi
    ends = []
    for section, way in ((0, -1), (-1, 1)):
        turn = angle if way < 0 else angle.flip(0)
        reach = half[:, section, None] * turn.cos()
        place = middle[:, section, None] + way * reach[..., None] * heading[:, section, None]
        ends.append((place, half[:, section, None] * turn.sin(), heading[:, section, None].expand(-1, CAPS, -1)))
    (first, first_half, first_way), (last, last_half, last_way) = ends
    heading = torch.cat([first_way, heading, last_way], 1)
    left = torch.stack([heading[..., 1], -heading[..., 0]], -1)  # y points down
    return torch.cat([first, middle, last], 1), torch.cat([first_half, half, last_half], 1), left


def _levels(flat: Array, size: tuple[int, int]) -> Array:
    """Compute a level (N,) for each stroke, above those of all lower strokes whose boxes touch the same grid cells."""
    cells = np.floor(flat * (CELLS / max(size))).astype(int).clip(0, CELLS - 1)
    low = np.minimum(cells[:, :-1].min(2), cells[:, 1:].min(2)).tolist()
    high = (np.maximum(cells[:, :-1].max(2), cells[:, 1:].max(2)) + 1).tolist()
    top, level = np.zeros((CELLS, CELLS), int), np.zeros(len(flat), int)
    for k in range(len(flat)):
        boxes = [top[y0:y1, x0:x1] for (x0, y0), (x1, y1) in zip(low[k], high[k], strict=True)]
        level[k] = max(box.max() for box in boxes)
        for box in boxes:
            box[:] = level[k] + 1
    return level


def _normals(points: Array) -> Array:
    """Compute the upward unit normals (N, S, A, 3) of point grids."""
    normal = np.cross(np.gradient(points, axis=1), np.gradient(points, axis=2))
    normal[normal[..., 2] < 0] *= -1
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    return np.where(length > 1e-12, normal / np.maximum(length, 1e-12), [0.0, 0.0, 1.0])


def triangles_of(count: int) -> Array:
    """Return the corner indices (count * TRIANGLES, 3) of triangles in ``count`` grids, counterclockwise from above."""
    corner = np.arange(POINTS).reshape(SECTIONS, ACROSS)
    here, right = corner[:-1, :-1], corner[1:, :-1]
    one = np.stack([here, right, right + 1, here, right + 1, here + 1], -1).reshape(-1, 3)
    return (POINTS * np.arange(count)[:, None, None] + one).reshape(-1, 3)
