"""Draw procedural paint marks with many random parameters, so that training covers more than our own brushes."""
# mypy: allow-untyped-defs

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from brushexp.contracts.kernels import function
from brushexp_recovery.curves.bezier import points_on
from brushexp_recovery.curves.nearest import length_of_line, nearest_place, unit
from brushexp_recovery.raster.blur import gaussian_blur
from brushexp_recovery.synthesis.hand import Random
from brushexp_recovery.synthesis.layout import StrokeLayout
from brushexp_recovery.synthesis.windows import StrokeWindows, Texel, close_gaps, join_windows, place_windows

Array = NDArray[Any]
F = np.float32

POINTS = 25  # number of points on a curve, the ends of its straight pieces
SAMPLES = 48  # number of samples of properties that vary along a stroke
MARGIN = 3.0  # margin around a stroke in pixels
CLOSED_GAP = 5  # maximum width in pixels of gaps between specks of paint that belong to the stroke's region
VARIETY = (0.8, 1.2)  # range of factors by which each stroke varies from the marks of its painting


class Marks(NamedTuple):
    """The look of one painting's strokes, each with small variations (domain randomisation, Tobin et al., 2017).

    Paint is deposited where the brush holds more paint than the bristle and the canvas grain require. The paint runs
    out along the stroke, so the stroke's end breaks up into streaks if ``bristle`` is large and into specks if
    ``grain`` is large. The unseen brushes of the benchmark differ: they have smooth outlines and straight ends, the
    knife has a constant thickness, and the dry brush fades in streaks by a fixed formula, without canvas grain or rim.
    """

    rough: float = 0.0  # roughness of the outline in half widths
    ends: float = 0.5  # length over which an end narrows, in half widths
    ragged: float = 0.0  # spread of the bristles' start and end in half widths
    tracks: int = 24  # number of bristles side by side
    full: float = 4.0  # paint held at the start
    dry: float = 0.0  # paint lost along the way
    bristle: float = 0.0  # deviation of the required paint between bristles
    grain: float = 0.0  # deviation of the required paint between places of the canvas
    sharp: float = 1.0  # sharpness of the transition from paint to no paint
    rim: float = 0.0  # change of tone where paint gathers at the rim (below 0) or is scraped away (above 0)
    streak: float = 0.1  # change of tone between bristles
    load: float = 0.0  # colour difference between the sides of the brush in sRGB
    thin: float = 0.0  # share of the paint that is missing at the start


def choose_marks(random: Random) -> Marks:
    """Choose the look of a painting's strokes at random, from even and smooth to broken up."""
    is_dry = bool(random.random() < 0.4)
    return Marks(
        rough=float(random.choice([0.0, 0.08, 0.15, 0.3])),
        ends=float(random.uniform(0.05, 1.5)),
        ragged=float(random.choice([0.0, 0.3, 1.0])),
        tracks=int(random.integers(4, 40)),
        full=float(random.uniform(0.6, 3.0)) if is_dry else 4.0,
        dry=float(random.uniform(0.5, 3.5)) if is_dry else 0.0,
        bristle=float(random.uniform(0.0, 1.2)),
        grain=float(random.uniform(0.0, 1.0)),
        sharp=float(random.uniform(0.6, 3.0)),
        rim=float(random.choice([0.0, 1.0]) * random.uniform(-0.35, 0.35)),
        streak=float(random.choice([0.0, 0.05, 0.1, 0.2])),
        load=float(random.choice([0.0, 0.0, 0.1, 0.25])),
        thin=float(random.choice([0.0, 0.0, 0.4])),
    )


def draw_marks(layout: StrokeLayout, marks: Marks, size: tuple[int, int], random: Random) -> StrokeWindows:
    """Draw strokes on a canvas (H, W), each in a window of its own size with one texel per pixel."""
    reach = 0.5 * layout.width * (1 + marks.rough) * (1.2 + 0.5 * marks.ragged) + MARGIN
    corner, side = place_windows(layout, reach)
    grain = standardise(gaussian_blur(random.normal(size=size), random.uniform(0.5, 1.6)))
    points = points_on(layout.curve - corner[:, None], POINTS)
    windows = [
        _draw_mark(points[k], layout.width[k], layout.color[k], int(side[k]), corner[k], grain, marks, random)
        for k in range(len(side))
    ]
    return join_windows(windows, side, corner + 0.5 * side[:, None], layout)


def _draw_mark(
    points: Array, width: float, color: Array, side: int, corner: Array, grain: Array, marks: Marks, random: Random
) -> Array:
    """Draw one stroke along points (POINTS, 2) in its window, and return its texels (side * side, len(Texel))."""
    bristles = _draw_bristles(random, marks.tracks)
    outline = _draw_outline(random)
    own_marks = Marks(*(np.array(marks, F) * random.uniform(*VARIETY, len(marks)).astype(F)))
    load = (random.normal(size=3) * marks.load).astype(F)
    texels = np.zeros((side, side, len(Texel)), F)
    _stamp(
        points.astype(F),
        F(width),
        color.astype(F),
        corner.astype(int),
        grain,
        bristles,
        outline,
        own_marks,
        load,
        texels,
    )
    return close_gaps(texels, CLOSED_GAP)


def standardise(noise: Array) -> Array:
    """Scale noise to a mean of 0 and a standard deviation of 1."""
    return ((noise - noise.mean()) / max(noise.std(), 1e-6)).astype(F)


def _draw_bristles(random: Random, tracks: int) -> Array:
    """Sample paint variations (`SAMPLES`, ``tracks``) that are rapid across the bristles and slow along each one."""
    slow = gaussian_blur(random.normal(size=(SAMPLES, tracks)), (random.uniform(3, 20), 0.3))
    return standardise(standardise(slow) + random.uniform(0.3, 1.5) * random.normal(size=tracks))


def _draw_outline(random: Random) -> Array:
    """Sample the deviations (`SAMPLES`, 2) of a stroke's two sides from a smooth outline."""
    return standardise(gaussian_blur(random.normal(size=(SAMPLES, 2)), (random.uniform(0.8, 6), 0)))


@function
def _stamp(points, width, color, corner, grain, bristles, outline, marks, load, texels):
    """Draw one stroke along ``points`` (P, 2) into empty texels (side, side, len(Texel)), leaving `CLOSED` unset."""
    half, side = F(0.5) * width, len(texels)
    length = length_of_line(points)
    reach = half * (1 + F(2.5) * marks.rough) + 2
    for y in range(side):
        for x in range(side):
            squared, along, across = nearest_place(points, x + F(0.5), y + F(0.5))
            if squared > (reach + half) ** 2 or abs(across) > reach:
                continue
            share = unit(along / length)
            row = min(int(share * SAMPLES), SAMPLES - 1)
            aside = min(max(across / width + F(0.5), F(0)), F(0.999))
            track = int(aside * bristles.shape[1])
            bristle = bristles[row, track]
            begin = F(0.5) * half * (marks.ragged * (bristles[0, track]) * F(0.4) - F(0.4))
            end = length + F(0.5) * half * (F(0.4) - marks.ragged * (bristles[SAMPLES - 1, track]) * F(0.4))
            tip = min(along - begin, end - along)
            edge = half * (1 + marks.rough * outline[row, 0 if across < 0 else 1])
            edge *= np.sqrt(1 - (1 - unit(tip / max(marks.ends * half, F(0.5)))) ** 2)
            alpha = unit((edge - abs(across)) / F(0.8) + F(0.5))
            alpha *= unit(tip / F(0.8) + F(0.5))
            if alpha <= 0:
                continue
            spot = grain[(y + corner[1]) % grain.shape[0], (x + corner[0]) % grain.shape[1]]
            paint = marks.full - marks.dry * share + marks.bristle * bristle + marks.grain * spot
            alpha *= unit(paint * marks.sharp + F(0.5))
            alpha *= 1 - marks.thin * (1 - share) ** 2
            depth = unit((edge - abs(across)) / max(F(0.35) * half, F(1)))
            tone = 1 + marks.streak * bristle + marks.rim * (1 - depth)
            for channel in range(3):
                own = color[channel] + (aside - F(0.5)) * load[channel]
                texels[y, x, channel] = alpha * unit(own * tone)
            texels[y, x, Texel.ALPHA] = alpha
            texels[y, x, Texel.HEIGHT] = alpha
