"""Draw strokes with the marks of chalk, brushes, knives, washes, pens and dabs, based on formulas and scans."""

from functools import lru_cache
from typing import Annotated

import torch
from torch import Tensor
from torch.nn import functional

from brushexp.contracts import one_of, register
from brushexp.contracts.families import Renderer
from brushexp.contracts.layers import SPREAD, Loop, Sheets, TexturedProfile, coordinates_of, sheets_of
from brushexp.contracts.strokes import (
    SCAN_BEYOND_ENDS,
    SCAN_BEYOND_SIDES,
    SCAN_COLUMNS,
    SCAN_ROWS,
    Strokes,
    curve_of,
    half_width_of,
    read_scans,
)
from brushexp_media.picture.noise import fractal_noise, gradient_noise

VARIANTS, LEVELS, ROWS, COLUMNS = 16, 6, 128, 192
WITH_DRY_ENDS = ("flat", "loaded", "knife")  # kinds whose last variants have dry ends
DRY = 4  # number of these variants
RUN_OUT = 5.0  # stroke widths after which the paint has run out
FULL_SCAN = 0.93  # covered share of the middle of a scan above which it has full ends
DRY_SCAN = 0.6  # least covered share of a scan with a dry end
RUBBED = 4  # number of rubbed-in variants of chalk, which come last
PEN = 2**28  # brush numbers of pen lines begin here, beyond those of any number of other strokes
THIN = 0.5  # pixels: below about twice this, strokes fade instead of becoming thinner
KINDS = ("chalk", "flat", "loaded", "knife", "wash", "pen", "dab")


@register("renderer", "marks")
class Marks(Renderer):
    """Bezier stroke with the mark of a tool: chalk, a flat or loaded brush, a palette knife, a wash, a pen or a dab.

    Textures are deterministic and need no training. Textures of brushes and knives have the outlines and dry ends of
    scanned strokes, and are filled in by formulas. A stroke has a dry end only if it is more than five widths long.
    With ``kind=pen``, strokes of ``init=drawing`` that are lines have the mark of a pen and are not optimised; all
    other strokes are washes.

    Args:
        kind: chalk, flat, loaded, knife, wash, pen (with washes) or dab.
    """

    cost = "not measured"

    def __init__(self, *, kind: Annotated[str, one_of(*KINDS)] = "flat") -> None:
        super().__init__()
        self.kind = kind

    def forward(self, strokes: Strokes) -> TexturedProfile:
        half = half_width_of(strokes)
        softened = (half.square() + THIN**2).sqrt()
        finer = (ROWS / (2 * SPREAD) / softened.detach()).clamp(1e-3, 1e9).log2().floor()
        once = torch.ones_like(strokes.brush)
        variant = strokes.brush % VARIANTS
        if self.kind == "pen":
            variant = variant // 2 + is_line(strokes) * (VARIANTS // 2)  # the second half of the textures are pen lines
        if self.kind in WITH_DRY_ENDS:
            curve = curve_of(strokes).detach()
            spent = (curve[:, 2] - curve[:, 0]).norm(dim=1) > RUN_OUT * 2 * half.detach()
            variant = torch.where(spent, variant, variant % (VARIANTS - DRY))
        return TexturedProfile(
            curve_of(strokes),
            softened,
            strokes.color,
            strokes.opacity * half / softened,
            look=variant * LEVELS + finer.clamp(0, LEVELS - 1).long(),
            repeats=once,
            flip=1 - 2 * (strokes.brush // VARIANTS % 2),
            sheets=_sheets(self.kind, half.device),
        )

    def held(self, strokes: Strokes) -> Tensor | None:
        return is_line(strokes).nonzero()[:, 0] if self.kind == "pen" else None


def is_line(strokes: Strokes) -> Tensor:
    """Mark the strokes (N,), bool, of ``init=drawing`` that are pen lines."""
    return strokes.brush >= PEN


@lru_cache(maxsize=len(KINDS))
@torch.no_grad()
def _sheets(kind: str, device: torch.device) -> Sheets:
    textures = torch.stack([DRAWN[kind](variant) for variant in range(VARIANTS)]).float()
    return sheets_of(textures.to(device), LEVELS, Loop(0, 0), rounded=True)


def _grid() -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return each texel's offset across a stroke, distance beyond its ends, t, and offset along it, in half widths."""
    across, t, before, beyond = (part[1:-1].double() for part in coordinates_of(ROWS, COLUMNS))
    outside = (beyond - before)[None].expand(ROWS, -1)  # beyond the ends
    along = (LENGTH * t + before + beyond)[None].expand(ROWS, -1)
    return across[:, None].expand(-1, COLUMNS), outside, t[None].expand(ROWS, -1), along


LENGTH = 5.0  # half widths: length of the stroke for which the grain is isotropic


def chalk(variant: int) -> Tensor:
    """Draw a mark made with the side of a stick of chalk, broken by grain, mainly at its edges and ends.

    Variants differ in pressure. The last `RUBBED` variants look rubbed in with a finger: they are soft and without
    grain.
    """
    across, outside, t, along = _grid()
    if variant >= VARIANTS - RUBBED:
        uneven = 0.12 * fractal_noise(along / 1.5, across / 1.5, 150 + variant, 2)
        inside = 1.0 + uneven - torch.hypot(across, outside.clamp(-1, 1))
        return torch.stack([(inside / 0.7).clamp(0, 1), 0.3 * uneven, 0.3 + 0 * t])
    grain = fractal_noise(along / 0.34, across / 0.34, 100 + variant, 3)
    streaks = gradient_noise(along / 6, across / 0.3, 200 + variant)
    inside = torch.minimum(1.0 - across.abs(), 0.55 - outside)  # distance to the edge in half widths
    press = 0.5 * (2 * (3 * variant % VARIANTS) / (VARIANTS - 1) - 1.2)
    opacity = (inside / 0.36).clamp(-1, 1) * 0.7 + 0.55 * grain + 1.1 * streaks + press - 0.02
    opacity = opacity.mul(1.6).add(0.5).clamp(0, 1)
    opacity = opacity * (inside > -0.12)
    tone = 0.05 * grain.clamp(-2, 2) + 0.1 * streaks
    return torch.stack([opacity, tone.clamp(-0.3, 0.3), 0.3 + 0 * t])


@lru_cache(maxsize=1)
def _scans() -> tuple[Tensor, Tensor]:
    """Read the coverage (M, 1, rows, columns), 0 to 1, of scanned strokes: first with full ends, then with dry ends."""
    scans = torch.from_numpy(read_scans().copy()).double()[:, None] / 255
    inner = scans[:, 0, :, SCAN_COLUMNS // 4 : -SCAN_COLUMNS // 4]
    filled, end = inner.mean((1, 2)), inner[:, SCAN_ROWS // 2 :].mean((1, 2))
    return scans[(filled > FULL_SCAN) & (end > FULL_SCAN)], scans[(filled > DRY_SCAN) & (end < FULL_SCAN)]


def _scan(variant: int, seed: int) -> Tensor:
    """Resample a scanned stroke to the coverage (ROWS, COLUMNS) of a texture; the last `DRY` variants have dry ends."""
    full, dry = _scans()
    number = torch.randperm(10_000, generator=torch.Generator().manual_seed(seed))[variant]
    scan = dry[number % len(dry)] if variant >= VARIANTS - DRY else full[number % len(full)]
    across, _, _, along = _grid()
    beyond = 2 * SCAN_BEYOND_ENDS  # half widths
    share = (along + beyond) / (LENGTH + 2 * beyond)
    places = torch.stack([across / (1 + 2 * SCAN_BEYOND_SIDES), 2 * share - 1], -1)[None]
    return functional.grid_sample(scan[None], places, align_corners=False)[0, 0]


def flat(variant: int) -> Tensor:
    """Draw the mark of a flat brush with opaque paint: an even layer with hair marks in a scanned stroke's outline."""
    across, _, _, along = _grid()
    hairs = gradient_noise(along / 40, across / 0.13, 300 + variant)
    hairs = hairs + gradient_noise(along / 25, across / 0.3, 400 + variant)
    opacity = ((_scan(variant, 310) - 0.35) / 0.3).clamp(0, 1)
    tone = 0.03 * hairs + 0.02 * across * (1 if variant % 2 else -1)
    return torch.stack([opacity, tone.clamp(-0.35, 0.35), (0.45 + 0.4 * hairs).clamp(0.05, 1)])


def loaded_brush(variant: int) -> Tensor:
    """Draw the mark of a brush with thick paint: a blunt start, a pointed end, furrows, and paint pushed aside."""
    across, outside, t, along = _grid()
    furrows = gradient_noise(along / 30, across / 0.34, 1000 + variant)
    furrows = furrows + 0.6 * gradient_noise(along / 14, across / 0.15, 1100 + variant)
    rough = fractal_noise(along / 0.8, across / 0.25, 1200 + variant, 2)
    lifted = (0.15 + 0.5 * (5 * variant % VARIANTS) / (VARIANTS - 1)) * t**2  # in half widths, varying between lifts
    inside = 0.99 - lifted + 0.03 * rough + 0.06 * furrows - torch.hypot(across, outside)
    dry = (1 + 2 * (_scan(variant, 1010) - 0.5)).clamp(0, 1) if variant >= VARIANTS - DRY else 1.0 + 0 * t
    tone = 0.22 * furrows + 0.04 * rough + 0.05 * across * (1 if variant % 2 else -1)
    film = 0.4 + 0.25 * furrows + 0.28 * torch.exp(-(((inside - 0.2) / 0.13) ** 2)) + 0.15 * (t - 0.5) + 0.03 * rough
    return torch.stack([(inside / 0.09).clamp(0, 1) * dry, tone.clamp(-0.3, 0.3), film.clamp(0.05, 1)])


def knife(variant: int) -> Tensor:
    """Draw the mark of a palette knife: smooth or torn, with paint heaped on one side and where the blade lifts off."""
    across, _, t, along = _grid()
    beyond = along - LENGTH
    drag = gradient_noise(along / 30, across / 0.6, 600 + variant)
    wavy = fractal_noise(along / 2.5, 0 * across + variant, 700 + variant, 2)
    hand = torch.rand(3, generator=torch.Generator().manual_seed(620 + variant)).tolist()
    slant = (0.5 * hand[0] - 0.25) * across  # the blade is set down and lifted at an angle
    side = ((0.98 + 0.04 * wavy + 0.04 * drag - across.abs()) / 0.05).clamp(0, 1)
    start = ((0.3 + 0.3 * hand[1] + slant + 0.08 * drag + along) / 0.1).clamp(0, 1)
    end = ((0.2 + 0.3 * hand[2] + slant + 0.12 * drag - beyond) / 0.1).clamp(0, 1)
    torn = ((_scan(variant, 610) - 0.2) / 0.4).clamp(0, 1) if variant >= VARIANTS - DRY else 1.0 + 0 * t
    heap = 0.9 if variant % 2 else -0.9
    ridge = torch.exp(-(((across - heap) / 0.12) ** 2)) * (0.6 + hand[1] + drag).clamp_min(0)
    lip = torch.exp(-(((beyond - 0.05 - 0.3 * hand[2] - slant) / 0.16) ** 2)) * (0.8 + wavy).clamp_min(0)
    film = 0.45 + 0.1 * drag + 0.5 * slant + 0.4 * ridge + 0.5 * lip
    tone = 0.16 * drag + 0.06 * gradient_noise(along / 25, across / 0.25, 650 + variant)
    return torch.stack([side * start * end * torn, tone.clamp(-0.3, 0.3), film.clamp(0.05, 1)])


def wash(variant: int) -> Tensor:
    """Draw the mark of a loaded round brush on wet paper: a flat tint with an irregular edge and no height."""
    across, outside, t, along = _grid()
    runs = 0.15 * fractal_noise(along / 1.1, across / 1.1, 800 + variant, 2)
    inside = 0.92 + runs - torch.hypot(across, outside)
    return torch.stack([(inside / 0.08).clamp(0, 1), 0 * t, 0 * t])


def pen(variant: int) -> Tensor:
    """Draw, in the first half of the variants, a wash; in the others, a pen line that swells towards its middle."""
    if variant < VARIANTS // 2:
        return wash(2 * variant)
    across, outside, t, along = _grid()
    rough = fractal_noise(along / 0.7, across / 0.7, 850 + variant, 2)
    swell = 1 - (0.6 + 0.3 * (variant % 2)) * (2 * t - 1).abs() ** (1.5 + 0.5 * (variant % 4))
    inside = 0.95 * swell + 0.07 * rough - torch.hypot(across, outside)
    return torch.stack([(inside / 0.2).clamp(0, 1), 0 * t, 0 * t])


def dab(variant: int) -> Tensor:
    """Draw a dab of the brush tip: a soft, uneven spot, thickest where the brush lifts off."""
    across, outside, t, _ = _grid()
    along = 0.7 * t + outside  # a dab is hardly longer than wide
    uneven = 0.16 * fractal_noise(along / 1.5, across / 1.5, 900 + variant, 2)
    inside = 0.95 + uneven - torch.hypot(across, outside)
    tone = 0.12 * gradient_noise(along / 3, across / 0.6, 950 + variant)
    return torch.stack([(inside / 0.36).clamp(0, 1), tone.clamp(-0.3, 0.3), 0.3 + 0.3 * t + 0.2 * inside.clamp(0, 1)])


DRAWN = {"chalk": chalk, "flat": flat, "loaded": loaded_brush, "knife": knife, "wash": wash, "pen": pen, "dab": dab}
