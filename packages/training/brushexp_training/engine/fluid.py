"""Simulate wet oil paint under a bristle brush."""

import math
from typing import Annotated

import numpy as np
import torch
from torch import Tensor

from brushexp.contracts import between, register
from brushexp.contracts.families import Engine, Simulated
from brushexp.contracts.machine import share
from brushexp.contracts.strokes import strokes_of
from brushexp_training.engine._bristles import TOUCH, UNITS, VERTICES, settle
from brushexp_training.engine._deposition import draw

GOLDEN = (1 + 5**0.5) / 2
BAND = 1.05  # radius of the brush, in half widths of its band, because the outermost bristles leave little paint
STEP = 0.05  # relative difference of scales below which brushes begin with the same pose
SCALES = (0.2, 256.0)  # range of the radii of simulated brushes, in 256ths of the window
FARTHEST_POINT = 4.0  # largest coordinate of points in half-windows
THIN, THICK = 10, 100  # numbers of bristles of Fluid Paint's thinnest and fullest brush, with their opacities below
LEAST_OPACITY, MOST_OPACITY_THIN, MOST_OPACITY_THICK = 0.002, 0.08, 0.025
DRAG = 0.14  # velocity of the paint per velocity and opacity of the bristle
Array = np.ndarray


@register("engine", "fluid")
class Fluid(Engine):
    """Bristles dragged through wet paint (Fluid Paint: Li, 2016; SPIRAL: Ganin et al., 2018): streaks, ragged ends.

    Bristles follow position-based dynamics. Each bristle splats paint and momentum where it touches the canvas, a fluid
    solver transports both, and the paint is lit according to its height. As in the source, lengths are in 256ths of the
    window, so that a stroke looks the same in windows of any size.

    There are four differences from the source. Thin splats lose no paint on a coarse grid. The brush turns with the
    stroke, as if held in a hand, and starts from rest, with its bristles trailing, each splayed in a different
    direction. The handle is as far ahead of the curve as the bristles trail behind the handle, so that the paint
    extends from start to end. Colours are mixed digitally, which is exact on an empty canvas, where RGB is the colour
    of flat paint and alpha is its coverage.

    Args:
        window: side of a picture in pixels, 8 to 1024.
        supersample: simulation cells per pixel, in each direction.
        frames: number of frames from start to end.
        after: frames for which the paint keeps flowing after the brush has left.
        bristles: number of bristles, 10 to 200.
        brushes: number of brushes; stroke i is painted with brush i modulo this number.
        load: amount of paint on the brush, 0 to 1.
        projection: whether the flow is kept nearly free of divergence, as in Fluid Paint but not in SPIRAL's port.
        jacobi: iterations of the pressure solver.
        fluidity: fraction of the flow's velocity that is kept from frame to frame, 0 to 1.
        gravity: acceleration of the bristles towards the canvas, in 256ths of the window per frame squared.
        damping: fraction of a bristle's velocity that is kept from frame to frame, 0 to 1.
        stiffness: stiffness of the stiffest bristle, 0 to 1.
        jitter: irregularity of the bristles' positions, 0 to 1.
        iterations: number of rounds of bristle constraints per frame.
        rest: number of frames in which the brush comes to rest before painting; it moves during the first half of them.
        approach: distance that the brush moves per frame while coming to rest, in brush radii; small values fray the
            start, and large values make strokes look combed.
        relief: factor by which the height of the paint is scaled for lighting; 0 makes the paint look flat.
    """

    has_heights = True

    def __init__(
        self,
        *,
        window: Annotated[int, between(8, 1024)] = 64,
        supersample: Annotated[int, between(1, 8)] = 2,
        frames: Annotated[int, between(1, 1000)] = 20,
        after: Annotated[int, between(0, 1000)] = 12,
        bristles: Annotated[int, between(10, 200)] = 100,
        brushes: Annotated[int, between(1, 1000)] = 1,
        load: Annotated[float, between(0, 1)] = 0.8,
        projection: bool = True,
        jacobi: Annotated[int, between(0, 100)] = 2,
        fluidity: Annotated[float, between(0, 1)] = 0.8,
        gravity: Annotated[float, between(0, 1000)] = 30.0,
        damping: Annotated[float, between(0, 1)] = 0.75,
        stiffness: Annotated[float, between(0, 1)] = 0.3,
        jitter: Annotated[float, between(0, 1)] = 0.5,
        iterations: Annotated[int, between(1, 1000)] = 20,
        rest: Annotated[int, between(0, 1000)] = 20,
        approach: Annotated[float, between(0, 10)] = 0.4,
        relief: Annotated[float, between(0, 100)] = 1.0,
    ) -> None:
        self.window, self.brushes, self.bristles, self.projection = window, brushes, bristles, projection
        self.jitter, self.stiffness = jitter, stiffness
        self.rest, self.approach, self.iterations = rest, np.float32(approach), iterations
        fullness = min((bristles - THIN) / (THICK - THIN), 1.0)  # fuller brushes cover as much
        most = MOST_OPACITY_THIN + (MOST_OPACITY_THICK - MOST_OPACITY_THIN) * fullness
        opacity = LEAST_OPACITY + (most - LEAST_OPACITY) * load if load else 0.0
        self.physics = tuple(map(np.float32, (gravity, damping, opacity, DRAG * opacity, fluidity, relief)))
        self.counts = (frames, iterations, jacobi, supersample, after)
        self._seed: int | None = None

    def __call__(self, parameters: Tensor, *, seed: int, first: int = 0) -> Simulated:
        if seed != self._seed:
            self._draw_brushes(seed)
        strokes = strokes_of(parameters.detach().cpu().float())
        units = 0.5 * float(UNITS)
        points = torch.cat([strokes.start, strokes.control, strokes.end], dim=1).clamp(-FARTHEST_POINT, FARTHEST_POINT)
        scale = (BAND * strokes.width * units).clamp(*SCALES)
        rows = torch.cat([(points + 1) * units, scale[:, None], strokes.color.clamp(0, 1)], dim=1).numpy()
        brush = (first + np.arange(len(rows))) % self.brushes
        pose = self._poses_for(brush, scale.numpy())
        images = np.empty((len(rows), 4, self.window, self.window), np.float32)
        heights = np.empty((len(rows), self.window, self.window), np.float32)
        poses = np.array(self._poses, np.float32).reshape(-1, 3, VERTICES, self.bristles)
        reach = np.array(self._reach, np.float32).reshape(-1, 2)
        brushes = (poses, reach, self._roots, self._stiffness)
        settings = (self.physics, self.counts, self.projection)
        share(draw, len(rows), rows, brush, pose, *brushes, *settings, images, heights)
        return Simulated(torch.from_numpy(images), torch.from_numpy(heights))

    def _draw_brushes(self, seed: int) -> None:
        """Sample every bristle's stiffness, direction of fall, and position in a jittered sunflower pattern."""
        n = self.bristles
        sources = (np.random.Philox(key=np.array([seed, brush], np.uint64)) for brush in range(self.brushes))
        words = np.stack([source.random_raw(4 * n).reshape(4, n) for source in sources])
        u = (words >> np.uint64(11)) * 2.0**-53
        i = np.arange(n)
        angle = (i + (u[:, 0] - 0.5) * self.jitter) * math.tau / GOLDEN**2
        radius = np.sqrt((i + u[:, 1] * self.jitter) / n)
        self._roots = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1).astype(np.float32)
        self._stiffness = (self.stiffness * u[:, 2]).astype(np.float32)
        self._splay = (math.tau * u[:, 3]).astype(np.float32)
        self._seed, self._place = seed, dict[tuple[int, int], int]()
        self._poses, self._reach = list[Array](), list[Array]()

    def _poses_for(self, brush: Array, scale: Array) -> Array:
        """Return the indices (n,) of the brushes' initial poses, after simulating any poses that are not stored yet."""
        node = np.rint(np.log(scale) / math.log1p(STEP)).astype(int)
        keys = list(zip(brush.tolist(), node.tolist(), strict=True))
        fresh = [key for key in dict.fromkeys(keys) if key not in self._place]
        if fresh:
            which = np.array([key[0] for key in fresh])
            scales = np.array([(1 + STEP) ** key[1] for key in fresh], np.float32)
            poses = np.empty((len(fresh), 3, VERTICES, self.bristles), np.float32)
            motion = (*self.physics[:2], self.iterations, self.rest, self.approach)
            brushes = (self._roots[which], self._splay[which], self._stiffness[which])
            share(settle, len(fresh), scales, *brushes, *motion, poses)
            for key, pose in zip(fresh, poses, strict=True):
                self._place[key] = len(self._poses)
                self._poses.append(pose)
                behind = -pose[0][pose[2] <= TOUCH]  # points that touch the canvas
                self._reach.append(np.array([np.quantile(behind, q) if behind.size else 0.0 for q in (0.95, 0.05)]))
        return np.array([self._place[key] for key in keys], np.int64)
