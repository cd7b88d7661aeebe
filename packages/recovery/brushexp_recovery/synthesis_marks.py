"""Marks of paint are drawn by a formula with many random parts, so that a network learns from more than our brushes."""
# mypy: allow-untyped-defs

from dataclasses import astuple, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp.compat.compiled import function
from brushexp_recovery.outlines import points_of
from brushexp_recovery.raster.blur import gaussian_blur
from brushexp_recovery.synthesis import Laid, Random
from brushexp_recovery.synthesis_looks import Drawn

Array = NDArray[Any]

POINTS = 25  # of a curve, the ends of its straight pieces
SAMPLES = 48  # of what changes along a stroke
MARGIN = 3.0  # pixels around a stroke
GAPS = 5  # pixels: gaps between specks of paint so narrow are of the stroke's region
F = np.float32


@dataclass(frozen=True)
class Marks:
    """How the strokes of one painting look; each departs from it a little (domain randomisation, Tobin et al., 2017).

    Paint lies where what the brush holds exceeds what the bristle and the grain of the canvas take from it. It runs out
    along the stroke, so a late part breaks up into streaks where ``bristle`` is large and into specks where ``grain``
    is. The unseen brushes of the benchmark differ: their outlines are smooth and their ends straight, their knife is
    of one thickness, and their dry brush fades by streaks of a fixed formula, with no grain of the canvas and no rim.
    """

    rough: float = 0.0  # of the outline, in half widths
    ends: float = 0.5  # half widths over which an end becomes narrow
    ragged: float = 0.0  # half widths by which bristles begin and end apart
    tracks: int = 24  # bristles side by side
    full: float = 4.0  # paint held at the start
    dry: float = 0.0  # paint lost on the way
    bristle: float = 0.0  # deviation between bristles of what they need
    grain: float = 0.0  # and between places of the canvas
    sharp: float = 1.0  # of the change from paint to no paint
    rim: float = 0.0  # change of tone where paint gathers at the rim (less than 0) or is scraped away (more)
    streak: float = 0.1  # change of tone between bristles
    load: float = 0.0  # difference of the colours at either side of the brush, sRGB
    thin: float = 0.0  # share of the paint that is missing at the start


def any_marks(random: Random) -> Marks:
    """Choose how strokes look, from even and smooth to broken up."""
    dry = bool(random.random() < 0.4)
    return Marks(
        rough=float(random.choice([0.0, 0.08, 0.15, 0.3])),
        ends=float(random.uniform(0.05, 1.5)),
        ragged=float(random.choice([0.0, 0.3, 1.0])),
        tracks=int(random.integers(4, 40)),
        full=float(random.uniform(0.6, 3.0)) if dry else 4.0,
        dry=float(random.uniform(0.5, 3.5)) if dry else 0.0,
        bristle=float(random.uniform(0.0, 1.2)),
        grain=float(random.uniform(0.0, 1.0)),
        sharp=float(random.uniform(0.6, 3.0)),
        rim=float(random.choice([0.0, 1.0]) * random.uniform(-0.35, 0.35)),
        streak=float(random.choice([0.0, 0.05, 0.1, 0.2])),
        load=float(random.choice([0.0, 0.0, 0.1, 0.25])),
        thin=float(random.choice([0.0, 0.0, 0.4])),
    )


def draw_marks(laid: Laid, marks: Marks, size: tuple[int, int], random: Random) -> Drawn:
    """Draw strokes on a canvas (H, W) in windows as large as they are, a texel a pixel."""
    reach = 0.5 * laid.width[:, None] * (1 + marks.rough) * (1.2 + 0.5 * marks.ragged) + MARGIN
    low, high = laid.curve.min(1) - reach, laid.curve.max(1) + reach
    side = np.ceil((high - low).max(1)).astype(int)
    corner = np.floor(0.5 * (low + high) - 0.5 * side[:, None])
    grain = _even(gaussian_blur(random.normal(size=size), random.uniform(0.5, 1.6)))
    points = points_of(laid.curve - corner[:, None], POINTS)
    windows = [
        _closed(_stamp(
            points[k].astype(F), F(laid.width[k]), laid.color[k].astype(F), int(side[k]), corner[k].astype(int), grain,
            _along(random, marks.tracks), _outline(random),
            np.array(astuple(marks), F) * random.uniform(0.8, 1.2, len(astuple(marks))).astype(F),
            (random.normal(size=3) * marks.load).astype(F),
        ))
        for k in range(len(side))
    ]  # fmt: skip
    first = np.concatenate([[0], np.cumsum(side**2)[:-1]])
    return Drawn(
        np.concatenate(windows), first, side, corner + 0.5 * side[:, None], side.astype(float), laid.curve, laid.width
    )


def _even(noise: Array) -> Array:
    """Give noise mean 0 and deviation 1."""
    return ((noise - noise.mean()) / max(noise.std(), 1e-6)).astype(F)


def _along(random: Random, tracks: int) -> Array:
    """Draw how bristles (`SAMPLES`, ``tracks``) differ: each from the others, and each slowly along the stroke."""
    slow = gaussian_blur(random.normal(size=(SAMPLES, tracks)), (random.uniform(3, 20), 0.3))
    return _even(_even(slow) + random.uniform(0.3, 1.5) * random.normal(size=tracks))


def _outline(random: Random) -> Array:
    """Draw how either side (`SAMPLES`, 2) departs from a smooth one."""
    return _even(gaussian_blur(random.normal(size=(SAMPLES, 2)), (random.uniform(0.8, 6), 0)))


def _closed(window: Array) -> Array:
    """Complete texels (side, side, 5) with their alpha whose gaps are closed: (side * side, 5)."""
    from scipy.ndimage import grey_closing  # noqa: PLC0415

    window[..., 4] = grey_closing(window[..., 3], size=GAPS)
    return window.reshape(-1, 5)


@function
def _stamp(points, width, color, side, corner, grain, bristles, outline, marks, second):
    """Draw one stroke along ``points`` (P, 2): (side, side, 5) colour times alpha, alpha, and 0."""
    rough, ends, ragged, _, full, dry, by_bristle, by_grain, sharp, rim, streak, _, thin = marks
    out = np.zeros((side, side, 5), F)
    half, pieces, tracks = F(0.5) * width, len(points) - 1, bristles.shape[1]
    length = F(0)
    for k in range(pieces):
        length += np.hypot(points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1])
    length = max(length, F(1e-3))
    reach = half * (1 + F(2.5) * rough) + 2
    for y in range(side):
        for x in range(side):
            best, along, across, before = F(1e9), F(0), F(0), F(0)
            for k in range(pieces):
                dx, dy = points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1]
                long = max(np.hypot(dx, dy), F(1e-6))
                px, py = x + F(0.5) - points[k, 0], y + F(0.5) - points[k, 1]
                u, v = (px * dx + py * dy) / long, (py * dx - px * dy) / long
                inner = min(max(u, F(0)), long)
                apart = (u - inner) ** 2 + v * v
                if apart < best:
                    first, last = k == 0 and u < 0, k == pieces - 1 and u > long
                    best, along, across = apart, before + (u if first or last else inner), v
                before += long
            if best > (reach + half) ** 2 or abs(across) > reach:
                continue
            share = min(max(along / length, F(0)), F(1))
            row = min(int(share * SAMPLES), SAMPLES - 1)
            edge = half * (1 + rough * outline[row, 0 if across < 0 else 1])
            aside = min(max(across / width + F(0.5), F(0)), F(0.999))
            track = int(aside * tracks)
            bristle = bristles[row, track]
            begin = F(0.5) * half * (ragged * (bristles[0, track]) * F(0.4) - F(0.4))
            end = length + F(0.5) * half * (F(0.4) - ragged * (bristles[SAMPLES - 1, track]) * F(0.4))
            tip = min(along - begin, end - along)
            taper = min(max(tip / max(ends * half, F(0.5)), F(0)), F(1))
            edge *= np.sqrt(1 - (1 - taper) ** 2)
            alpha = min(max((edge - abs(across)) / F(0.8) + F(0.5), F(0)), F(1))
            alpha *= min(max(tip / F(0.8) + F(0.5), F(0)), F(1))
            if alpha <= 0:
                continue
            spot = grain[(y + corner[1]) % grain.shape[0], (x + corner[0]) % grain.shape[1]]
            held = full - dry * share + by_bristle * bristle + by_grain * spot
            alpha *= min(max(held * sharp + F(0.5), F(0)), F(1))
            alpha *= 1 - thin * (1 - share) ** 2
            depth = min(max((edge - abs(across)) / max(F(0.35) * half, F(1)), F(0)), F(1))
            tone = 1 + streak * bristle + rim * (1 - depth)
            for c in range(3):
                out[y, x, c] = alpha * min(max((color[c] + (aside - F(0.5)) * second[c]) * tone, F(0)), F(1))
            out[y, x, 3] = alpha
    return out
