"""Place strokes as in an ink drawing: washes, hatching by tone, and contours by pressure."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import torch
from torch import Tensor

from brushexp.bounds import Rule, above, between
from brushexp.pictures.load import named_color
from brushexp.pictures.structure import along_edges, sampled_at, structure_tensor, worst_of_cells
from brushexp.plugins.init.base import Initializer
from brushexp.registry import register
from brushexp.strokes.bezier import strokes_along
from brushexp.strokes.catalogue import Strokes
from brushexp_media.lines import anisotropy_of, edge_lines, find_apart, luminance
from brushexp_media.noise import fractal_noise

Array = np.ndarray
STEPS = 8  # points of a line on each side of its middle
ANGLES = (-0.9, -0.35, 0.75)  # radians of the hatchings, the first of the half tones
BROADEST = 0.06  # width of a wash, in longer sides
GLAZES = 3  # tones of a wash
DEEP = 0.7  # share of ink in a wash where the picture is black
EDGE, LOST = 0.06, 0.45  # softness of an edge of a wash, and of one that is lost besides, in widths of its strokes
FOUND = 4.0  # slope of darkness, per longer side, from which on an edge of a wash is crisp
FRAME = 0.018  # longer sides: nearer to the edge of the picture lines are no contours
SMOOTH, SMOOTH_WASH = 0.004, 0.008  # deviation of the blur of tones under hatchings and washes, in longer sides
MARGIN, WAVER, WAVES = 0.022, 0.35, 0.06  # longer sides that stay bare; deviation of its edge over it; longer sides
FAINTEST = 0.12  # strength of a line below which none is drawn
FEATURES = 0.35  # share of contours that are fine ones where one looks first; as many are elsewhere
FINER = 0.55  # size of fine contours over that of the others
SPARED = 0.6  # share of darkness, times that of light, that hatchings and washes leave to lines where one looks first
SUBTLE, CLEAR = 0.004, 0.012  # least difference, over the luma around it, of fine ones where one looks first, elsewhere
SPARSE = 0.3  # share of the lines of a hatching that are left where it begins
GROUPS, SWAY = 0.09, 0.12  # longer sides from one group of lines to the next, by how much they turn, radians
PRESSED, LONGER = 0.3, 0.45  # deviations of the logarithms of widths and lengths of hatchings
DOT = 3.0  # widths below which a contour is no line
MORE, APART = 3, 0.7  # lines that are traced over those that are drawn; widths between two of these
SHARPEST = 0.5  # cosine of the sharpest turn that a line follows in one step
FORM, TURN = 0.02, 1.2  # deviation of the blur of forms, longer sides, and by how much hatchings follow them, radians
EVEN = 0.02  # darkness: so much less counts as dark, too, lest even areas be left out
INK = Rule(named_color)


@register("init", "drawing")
@dataclass(kw_only=True)
class Drawing(Initializer):
    """Contours that swell with contrast, hatchings where it is dark, and one or two washes below them.

    Source: pen-and-ink illustration as Winkenbach and Salesin (1994) describe it: tone by hatchings that are added one
    after the other, outlines where neighbouring tones do not tell things apart. Differs: hatchings have angles that are
    fixed but for `TURN` and `SWAY`. With a focus there are finer contours and fewer hatchings in it.

    Args:
        contours: share of the strokes that are contours, 0 to 1.
        washes: share of the strokes that are washes, 0 to 1.
        tones: darkness (0 white to 1 black) from which on there is the first, second and third hatching.
        wash_tones: darkness from which on there is the light and the dark wash.
        white: share of the picture that stays without hatching and wash at least, 0 to 1.
        width: of a contour, in thousandths of the longer side.
        length: of a line, in hundredths of the longer side.
        color: of the ink, as '#rrggbb'.
        wash: of the light wash; the dark one lies between it and the ink.
    """

    contours: Annotated[float, between(0, 1)] = 0.4
    washes: Annotated[float, between(0, 1)] = 0.2
    tones: tuple[float, float, float] = (0.5, 0.68, 0.84)
    wash_tones: tuple[float, float] = (0.52, 0.74)
    white: Annotated[float, between(0, 1)] = 0.5
    width: Annotated[float, above(0, 100)] = 3.4
    length: Annotated[float, above(0, 100)] = 7.0
    color: Annotated[str, INK] = "#16130f"
    wash: Annotated[str, INK] = "#c9c3b8"

    def __call__(self, target: Tensor, n: int, generator: torch.Generator, focus: Tensor | None = None) -> Strokes:
        from scipy.ndimage import gaussian_filter  # noqa: PLC0415  (slow to import)

        picture = target.numpy().astype(np.float64)
        side, dark = max(picture.shape), 1 - luminance(picture)
        weight = None if focus is None else focus.numpy().astype(np.float64)
        tone = dark if weight is None else dark * (1 - SPARED * (1 - dark) * weight / weight.max())
        random = np.random.default_rng(int(torch.randint(2**31, (1,), generator=generator)))
        tone = tone * _within_margin(tone.shape, random)
        washes = round(n * self.washes)
        lines = min(n - washes, round(n * self.contours))
        turned = _swayed(forms(picture), random)
        return Strokes.join(
            self._washes(gaussian_filter(tone, SMOOTH_WASH * side), washes, random),
            self._hatching(gaussian_filter(tone, SMOOTH * side), turned, n - washes - lines, random),
            contours(picture, lines, self._longest(side), self._widest(side), rgb_of(self.color), weight),
        )

    def _hatching(self, dark: Array, turned: Array, n: int, random: np.random.Generator) -> Strokes:
        """Lay lines over dark places at the angles, ``turned`` (H, W) by forms, as close as ``n`` lines allow."""
        side, tones = max(dark.shape), self._above(self.tones, dark)
        area = sum(float((dark > tone).sum()) for tone in tones)
        gap = max(1.2, area / max(n, 1) / (0.9 * self._longest(side)))
        hatchings = zip(tones, ANGLES, strict=True)
        parts = [hatching(dark, tone, angle, turned, gap, self._longest(side), random) for tone, angle in hatchings]
        curve = np.concatenate(parts)
        curve = curve[np.sort(random.permutation(len(curve))[:n])]
        darkness = sampled_at(dark, *curve.mean(1).T)
        width = self._widest(side) * (0.08 + 0.5 * darkness**2) * random.lognormal(0, PRESSED, len(curve))
        return strokes_of(curve, width, darkness > 0, rgb_of(self.color), n)

    def _washes(self, dark: Array, n: int, random: np.random.Generator) -> Strokes:
        """Fill dark places with strokes that are as broad as there is room: a wash, and another where it is dark.

        Each has one of `GLAZES` tones, that of its place, and lies over lighter ones. Its edge is crisp where the
        picture has one nearby, and lost where forms are soft.
        """
        from scipy.ndimage import distance_transform_edt  # noqa: PLC0415  (slow to import)

        tones, light = self._above(self.wash_tones, dark), rgb_of(self.wash)
        flow = along_edges(structure_tensor(dark[None], SMOOTH_WASH * max(dark.shape)))  # along the edges of the wash
        xx, _, yy = structure_tensor(dark[None], 0.0)
        steep = np.sqrt(xx + yy) * max(dark.shape)
        areas = [float((dark > tone).sum()) for tone in tones]
        first = round(n * areas[0] / max(sum(areas), 1))
        parts = []
        for tone, count in zip(tones, (first, n - first), strict=True):
            room, ends = distance_transform_edt(np.pad(dark > tone, 1, mode="edge"), return_indices=True)
            room, ends = room[1:-1, 1:-1].clip(0, BROADEST / 2 * max(dark.shape)), ends[:, 1:-1, 1:-1] - 1
            rows, columns = np.nonzero(room)
            chosen = random.integers(len(rows), size=count if len(rows) else 0)
            deep = ((dark[rows[chosen], columns[chosen]] - tones[0]) / max(1 - tones[0], EVEN)).clip(0, 1)
            deep = np.floor(deep * GLAZES).clip(0, GLAZES - 1) / (GLAZES - 1)
            order = np.argsort(deep, kind="stable")
            deep, rows, columns = deep[order], rows[chosen[order]], columns[chosen[order]]
            places, half = np.stack([columns, rows], 1) + 0.5, room[rows, columns]
            curve = followed(places, flow, 6 * half, room, 0.8 * half)
            color = light + DEEP * deep[:, None] * (rgb_of(self.color) - light)
            strokes = strokes_of(curve, 2 * half, half > 0, color, count)
            lost = np.zeros(count)
            y, x = ends[:, rows, columns]
            lost[: len(rows)] = (1 - sampled_at(steep, x, y) / FOUND).clip(0, 1)
            softness = (EDGE + LOST * torch.from_numpy(lost).float()) * strokes.width
            parts.append(replace(strokes, softness=softness))
        return Strokes.join(*parts)

    def _above(self, tones: Sequence[float], dark: Array) -> list[float]:
        """Raise tones where the picture is so dark that too little of the paper would stay white."""
        left = [1 - (1 - self.white) / 2**k for k in range(len(tones))]
        return [max(tone, float(np.quantile(dark, share)) - EVEN) for tone, share in zip(tones, left, strict=True)]

    def _longest(self, side: int) -> float:
        return 0.01 * self.length * side

    def _widest(self, side: int) -> float:
        return 0.001 * self.width * side


def contours(picture: Array, n: int, length: float, width: float, color: Array, focus: Array | None = None) -> Strokes:
    """Trace lines of a picture (3, H, W), at most one from each of its cells: those that are strong and straight.

    ``length`` and ``width``, in pixels, are those of the strongest. With a focus (H, W) a share of them is finer, and
    where it is more than half of its largest, faint ones are drawn, too: eyes and mouths are made of those.
    """
    side = max(picture.shape)
    frame = round(FRAME * side)
    inner = np.pad(np.ones(np.array(picture.shape[1:]) - 2 * frame), frame) if min(picture.shape[1:]) > 2 * frame else 0
    coarse = np.maximum(edge_lines(picture), 0.8 * edge_lines(picture, 2.0)) * inner
    if focus is None:
        return _traced(picture, coarse, n, length, width, color)
    attended = focus > 0.5 * focus.max()
    few = round(FEATURES * n)
    faint, clear = (np.maximum(*(edge_lines(picture, k, least) for k in (FINER, 1.0))) for least in (SUBTLE, CLEAR))
    return Strokes.join(
        _traced(picture, coarse, n - 2 * few, length, width, color),
        _traced(picture, clear * inner * ~attended, few, length, FINER * width, color),
        _traced(picture, faint * inner * attended, few, length, FINER * width, color, area=float(attended.sum())),
    )


def _traced(
    picture: Array, lines: Array, n: int, length: float, width: float, color: Array, area: float | None = None
) -> Strokes:
    """Trace n lines of a map (H, W) of their strength, in cells that divide an ``area`` in pixels, or all of it."""
    side = max(picture.shape)
    flow = along_edges(structure_tensor(picture, max(1.0, SMOOTH * side)))
    _, x, y = worst_of_cells(lines, max(2, round(0.6 * math.sqrt((area or lines.size) / max(n, 1)))))
    strength = sampled_at(lines, x, y)
    # Outlines are straight for long, texture is not.
    straight = anisotropy_of(structure_tensor(picture, max(1.0, SMOOTH_WASH * side)))
    best = np.argsort(-strength * sampled_at(straight, x, y), kind="stable")[: MORE * n]
    places, strength = np.stack([x, y], 1)[best] + 0.5, strength[best]
    pressed = 0.35 + 0.65 * strength
    curve = followed(places, flow, 0.5 * length * pressed, lines, FAINTEST)
    seen = (strength > FAINTEST) & (np.linalg.norm(curve[:, 2] - curve[:, 0], axis=1) > DOT * width)
    kept = find_apart(curve[seen], picture.shape[1:], APART * width)[:n]
    return strokes_of(curve[seen][kept], (width * pressed)[seen][kept], np.ones(len(kept), bool), color, n)


def forms(picture: Array) -> Array:
    """Compute by how much hatchings turn (H, W) to follow the forms of a picture (3, H, W): radians, at most `TURN`."""
    side = max(picture.shape)
    flow = along_edges(structure_tensor(picture, FORM * side))
    angle = (flow - ANGLES[0] + math.pi / 2) % math.pi - math.pi / 2
    return angle.clip(-TURN, TURN)


def _within_margin(size: tuple[int, ...], random: np.random.Generator) -> Array:
    """Find what lies within a margin (H, W) that the draughtsman leaves, whose edge wavers."""
    y, x = (np.minimum(np.arange(side), np.arange(side)[::-1]) / max(size) for side in size)
    reach = np.minimum(x, y[:, None])
    return reach > MARGIN * (1 + WAVER * noise_of(size, WAVES, random))


def noise_of(size: tuple[int, ...], cell: float, random: np.random.Generator) -> Array:
    """Compute noise (H, W) in cells of so many longer sides, of mean 0 and deviation 1."""
    y, x = (torch.arange(side, dtype=torch.float64) / (cell * max(size)) for side in size)
    noise = fractal_noise(x.expand(len(y), -1), y[:, None].expand(-1, len(x)), int(random.integers(2**31)), 2)
    return noise.double().numpy()


def _swayed(turned: Array, random: np.random.Generator) -> Array:
    """Turn hatchings (H, W), radians, a little from one group of lines to the next."""
    return turned + SWAY * noise_of(turned.shape, GROUPS, random)


def hatching(
    dark: Array, tone: float, angle: float, turned: Array, gap: float, length: float, random: np.random.Generator
) -> Array:
    """Draw curves (n, 3, 2), some ``gap`` pixels apart, where a map (H, W) is above ``tone``; ``turned`` is (H, W)."""
    height, width = dark.shape
    half = 0.5 * math.hypot(height, width)
    u, v = np.meshgrid(np.arange(-half, half, 0.8 * length), np.arange(-half, half, gap))
    u = u + length * (random.uniform(-0.5, 0.5, len(v))[:, None] + 0.15 * random.standard_normal(u.shape))
    v = v + 0.4 * gap * random.standard_normal(v.shape)
    c, s = math.cos(angle), math.sin(angle)
    places = np.stack([width / 2 + c * u - s * v, height / 2 + s * u + c * v], -1).reshape(-1, 2)
    places = places[((places >= 0) & (places < (width, height))).all(1)]
    deeper = (sampled_at(dark, *places.T) - tone) / max(1 - tone, EVEN)
    places = places[(deeper > 0) & (random.random(len(places)) < SPARSE + (1 - SPARSE) * 1.4 * deeper)]
    reach = 0.5 * length * random.lognormal(-0.4, LONGER, len(places))
    return followed(places, angle + turned, reach, dark, tone)


def followed(places: Array, flow: Array, reach: Array, field: Array, least: Array | float) -> Array:
    """Follow a flow, radians, both ways from places (n, 2) as far as ``reach`` (n,) or a field (H, W) allows.

    Curves (n, 3, 2) end where the field is no longer above ``least``; a flow (1, 1) is the same everywhere.
    """
    ends = []
    for sign in (-1.0, 1.0):
        point, going = places.astype(float), np.ones(len(places), bool)
        ahead = sign * _unit(sampled_at(flow, *point.T))
        for _ in range(STEPS):
            following = point + ahead * (reach / STEPS)[:, None]
            going &= sampled_at(field, *following.T) > least
            point = np.where(going[:, None], following, point)
            turned = _unit(sampled_at(flow, *point.T))
            turned *= np.where((turned * ahead).sum(1) < 0, -1, 1)[:, None]
            ahead = np.where((turned * ahead).sum(1)[:, None] > SHARPEST, turned, ahead)
        ends.append(point)
    start, end = ends
    return np.stack([start, 2 * places - (start + end) / 2, end], 1)


def _unit(angle: Array) -> Array:
    return np.stack([np.cos(angle), np.sin(angle)], 1)


def rgb_of(color: str) -> Array:
    """Return the colour (3,), 0 to 1, that a name or '#rrggbb' says."""
    return np.frombuffer(named_color(color, "init.color") or b"", np.uint8) / 255


def strokes_of(curve: Array, width: Array, seen: Array, color: Array, n: int) -> Strokes:
    """Make n strokes: the curves, of one colour or one each, and for those that are lacking some without ink."""
    lacking, color = n - len(curve), np.broadcast_to(color, (len(curve), 3))
    curve, width, seen, color = (
        np.concatenate([part, np.full((lacking, *part.shape[1:]), fill, part.dtype)])
        for part, fill in ((curve, 0), (width, 1), (seen, False), (color, 0))
    )
    paint = torch.from_numpy(color)
    opacity = torch.from_numpy(seen).double()
    return strokes_along(torch.from_numpy(curve), torch.from_numpy(width), paint, opacity).map(Tensor.float)
