"""The ``litwinowicz`` painter: short strokes, placed on a grid, that end at edges."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from brushexp.contracts import at_least, between, register
from brushexp.contracts.families import Painter, PaintRequest, PaintState
from brushexp.contracts.pictures import sample_at
from brushexp_painters._laying import LUMINANCE, Array, lay, numpy_generator, strokes_from_arrays

DATA_WEIGHT = 1e3  # weight of reliable directions relative to the bending of the field


@register("painter", "litwinowicz")
@dataclass(kw_only=True)
class Litwinowicz(Painter):
    """Short straight strokes on a grid, oriented along edges and clipped at edges.

    Source: Litwinowicz, 1997 (Processing Images and Video for an Impressionist Effect). A stroke grows from its centre
    in both directions, pixel by pixel, until it reaches its length or the Sobel magnitude of the smoothed luminance
    falls. It has the picture's colour at its centre and is normal to the gradient; where the gradient is weak, a
    thin-plate spline interpolates the direction. Length, thickness, direction, colour and order are varied at random.

    Unlike in the paper, the spacing follows from ``strokes``. Lengths, which the paper gives in pixels at a spacing of
    2, are in spacings, and so is the width of the blur, which the paper does not give. The spline is discrete, on the
    grid, and interpolates doubled angles, so that gradients of opposite signs do not cancel. A stroke ends once the
    magnitude has fallen by ``fall`` from its maximum; in the paper it ends at any fall, because 8-bit values hid the
    noise. This painter is for single pictures: in films (`image=clip.mp4`), optical flow carries the strokes.

    Args:
        length: minimum and maximum length of an unclipped stroke, in spacings.
        thickness: minimum and maximum thickness, in spacings.
        smoothing: standard deviation of the Gaussian before gradients, in spacings.
        flat: gradient, in both x and y, below which directions are interpolated, in 8-bit levels per pixel.
        clip: whether strokes end at edges.
        fall: fall in the Sobel magnitude that marks an edge, in 8-bit levels per pixel.
        stray: maximum random change in direction, in degrees.
        stray_color: maximum random change in red, green and blue, in 8-bit levels.
        stray_intensity: maximum random change in all three channels together, as a fraction.
        opacity: fraction of the paint below that a stroke hides, up to 1.
    """

    kind = "local rules"
    author = "Litwinowicz"

    length: Annotated[tuple[float, float], between(0, 1000)] = (2.0, 5.0)
    thickness: Annotated[tuple[float, float], between(0.01, 1000)] = (1.5, 2.0)
    smoothing: Annotated[float, at_least(0)] = 0.5
    flat: Annotated[float, at_least(0)] = 3.0
    clip: bool = True
    fall: Annotated[float, at_least(0)] = 1.0
    stray: Annotated[float, between(0, 180)] = 15.0
    stray_color: Annotated[float, between(0, 255)] = 15.0
    stray_intensity: Annotated[float, between(0, 1)] = 0.15
    opacity: Annotated[float, between(0, 1)] = 1.0

    def __call__(self, request: PaintRequest) -> Iterator[PaintState]:
        from scipy.ndimage import gaussian_filter  # noqa: PLC0415  (--help does not need it)

        picture, random = request.target.cpu().numpy().astype(np.float64), numpy_generator(request.generator)
        height, width = request.size
        rows = max(1, min(request.n, round(height / request.pitch)))
        columns = max(1, request.n // rows)
        spacing = np.sqrt(height * width / (rows * columns))
        top, left = np.divmod(np.arange(rows * columns), columns)
        x, y = (left + 0.5) * width / columns, (top + 0.5) * height / rows
        luminance = np.tensordot(LUMINANCE, picture, 1)
        smooth = gaussian_filter(luminance, self.smoothing * spacing, mode="nearest")
        angle = self._directions(smooth, x, y, (rows, columns))
        angle = angle + np.radians(self.stray) * random.uniform(-1, 1, len(x))
        middle, ahead = np.stack([x, y], 1), np.stack([np.cos(angle), np.sin(angle)], 1)
        reach = 0.5 * spacing * random.uniform(min(self.length), max(self.length), len(x))
        ends = [middle + way * self._grow(smooth, middle, way * ahead, reach)[:, None] * ahead for way in (-1, 1)]
        color = sample_at(picture, x, y).T + self.stray_color / 255 * random.uniform(-1, 1, (len(x), 3))
        color = color * (1 + self.stray_intensity * random.uniform(-1, 1, (len(x), 1)))
        thickness = spacing * random.uniform(min(self.thickness), max(self.thickness), len(x))
        curves = np.stack([ends[0], (ends[0] + ends[1]) / 2, ends[1]], 1)
        order = random.permutation(len(x))
        yield from lay(strokes_from_arrays(curves[order], thickness[order], color[order], self.opacity))

    def _directions(self, smooth: Array, x: Array, y: Array, grid: tuple[int, int]) -> Array:
        """Compute angles (n,) normal to the gradient at a grid's nodes, interpolated where the gradient is weak."""
        padded = np.pad(255 * smooth, 1, mode="edge")
        slope = np.stack([padded[1:-1, 2:] - padded[1:-1, :-2], padded[2:, 1:-1] - padded[:-2, 1:-1]]) / 2
        gx, gy = sample_at(slope, x, y)
        reliable = (np.maximum(abs(gx), abs(gy)) >= self.flat).astype(float)
        twice = 2 * np.arctan2(gx, -gy)  # the doubled angle of the normal
        field = thin_plate(np.stack([np.cos(twice), np.sin(twice)], 1), reliable, grid)
        return 0.5 * np.arctan2(field[:, 1], field[:, 0])

    def _grow(self, smooth: Array, middle: Array, ahead: Array, reach: Array) -> Array:
        """Return how far strokes grow from their centres (n, 2) in directions (n, 2), at most ``reach`` (n,) pixels."""
        from scipy.ndimage import map_coordinates, sobel  # noqa: PLC0415

        edges = 255 / 8 * np.hypot(sobel(smooth, 0), sobel(smooth, 1))  # levels per pixel
        grown, last, growing = np.zeros(len(reach)), np.zeros(len(reach)), np.ones(len(reach), bool)
        for step in range(int(reach.max(initial=0)) + 1):
            place = middle + step * ahead
            here = map_coordinates(edges, (place - 0.5).T[::-1], order=1, mode="nearest")
            growing &= step <= reach
            if self.clip:
                growing &= here >= last - self.fall
            grown, last = np.where(growing, step, grown), np.maximum(here, last)
        return grown


def thin_plate(values: Array, reliable: Array, grid: tuple[int, int]) -> Array:
    """Compute the least-bending field (n, k) on a grid of n nodes, given ``values`` where ``reliable`` (n,) is 1.

    The field minimises the sum of squared Laplacians with mirrored borders, and is 0 if no value is reliable.
    """
    from scipy.sparse import diags, identity, kron  # noqa: PLC0415
    from scipy.sparse.linalg import splu  # noqa: PLC0415

    def line(n: int) -> Array:
        """Return the matrix of second differences between n values in a row, with mirrored borders."""
        inner = np.ones(n - 1)
        return diags([inner, -(np.r_[0, inner] + np.r_[inner, 0]), inner], [-1, 0, 1], shape=(n, n))

    rows, columns = grid
    laplacian = kron(line(rows), identity(columns)) + kron(identity(rows), line(columns))
    system = laplacian.T @ laplacian + diags([DATA_WEIGHT * reliable + 1e-6], [0])
    return splu(system.tocsc()).solve(DATA_WEIGHT * reliable[:, None] * values)
