"""Draw strokes with the marks of chalk, flat brushes, palette knives, washes and dabs, whose textures are formulas."""

from functools import lru_cache
from typing import Annotated

import torch
from torch import Tensor

from brushexp.contracts import one_of, register
from brushexp.contracts.families import Renderer
from brushexp.contracts.layers import SPREAD, Loop, Sheets, TexturedProfile, coordinates_of, sheets_of
from brushexp.contracts.strokes import Strokes, curve_of, half_width_of
from brushexp_media.picture.noise import fractal_noise, gradient_noise

VARIANTS, LEVELS, ROWS, COLUMNS = 8, 6, 128, 192
RUBBED = 2  # the last variants of chalk, which are rubbed in
THIN = 0.5  # pixels: strokes do not get thinner than about twice this, but fainter
KINDS = ("chalk", "flat", "loaded", "knife", "wash", "dab")


@register("renderer", "marks")
class Marks(Renderer):
    """Bezier stroke with the mark of a tool: chalk, a flat or a loaded brush, a palette knife, a wash, a dab.

    Textures are drawn by formulas, the same every time; nothing is trained.

    Args:
        kind: chalk, flat, loaded, knife, wash or dab.
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
        return TexturedProfile(
            curve_of(strokes),
            softened,
            strokes.color,
            strokes.opacity * half / softened,
            look=strokes.brush % VARIANTS * LEVELS + finer.clamp(0, LEVELS - 1).long(),
            repeats=once,
            flip=1 - 2 * (strokes.brush // VARIANTS % 2),
            sheets=_sheets(self.kind, half.device),
        )


@lru_cache(maxsize=len(KINDS))
@torch.no_grad()
def _sheets(kind: str, device: torch.device) -> Sheets:
    textures = torch.stack([DRAWN[kind](variant) for variant in range(VARIANTS)]).float()
    return sheets_of(textures.to(device), LEVELS, Loop(0, 0), rounded=True)


def _grid() -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return of each texel: across, how far from the nearer end inside the stroke, t, and along, all in half widths."""
    across, t, before, beyond = (part[1:-1].double() for part in coordinates_of(ROWS, COLUMNS))
    outside = (beyond - before)[None].expand(ROWS, -1)  # beyond the ends
    along = (LENGTH * t + before + beyond)[None].expand(ROWS, -1)
    return across[:, None].expand(-1, COLUMNS), outside, t[None].expand(ROWS, -1), along


LENGTH = 5.0  # half widths: length of the stroke for which grain is as long as wide


def chalk(variant: int) -> Tensor:
    """Draw the side of a stick of chalk: broken by grain, most at its edges and ends; some press harder than others.

    The last `RUBBED` are rubbed in by a finger: soft, and without grain.
    """
    across, outside, t, along = _grid()
    if variant >= VARIANTS - RUBBED:
        uneven = 0.12 * fractal_noise(along / 1.5, across / 1.5, 150 + variant, 2)
        inside = 1.0 + uneven - torch.hypot(across, outside.clamp(-1, 1))
        return torch.stack([(inside / 0.7).clamp(0, 1), 0.3 * uneven, 0.3 + 0 * t])
    grain = fractal_noise(along / 0.34, across / 0.34, 100 + variant, 3)
    streaks = gradient_noise(along / 6, across / 0.3, 200 + variant)
    inside = torch.minimum(1.0 - across.abs(), 0.55 - outside)  # half widths to the edge
    press = 0.5 * (2 * (3 * variant % VARIANTS) / (VARIANTS - 1) - 1.2)
    opacity = (inside / 0.36).clamp(-1, 1) * 0.7 + 0.55 * grain + 1.1 * streaks + press - 0.02
    opacity = opacity.mul(1.6).add(0.5).clamp(0, 1)
    opacity = opacity * (inside > -0.12)
    tone = 0.05 * grain.clamp(-2, 2) + 0.1 * streaks
    return torch.stack([opacity, tone.clamp(-0.3, 0.3), 0.3 + 0 * t])


def flat(variant: int) -> Tensor:
    """Draw a flat brush full of body colour: square ends, the last one dry, and streaks of its hairs."""
    across, outside, t, along = _grid()
    hairs = gradient_noise(along / 40, across / 0.13, 300 + variant)
    hairs = hairs + gradient_noise(along / 25, across / 0.3, 400 + variant)
    grain = fractal_noise(along / 0.7, across / 0.12, 500 + variant, 2)
    side = ((0.98 + 0.03 * grain - across.abs()) / 0.06).clamp(0, 1)
    reach = 0.35 + 0.22 * hairs
    start = ((reach + (outside.clamp_max(0) + 0)) / 0.1 + 0 * t).clamp(0, 1)
    end = ((reach - outside.clamp_min(0)) / 0.1).clamp(0, 1)
    dry = ((1 - t) * 2.6 + 0.9 + 0.8 * hairs + 0.45 * grain).clamp(0, 1)
    tone = 0.04 * hairs + 0.1 * (0.5 - t) + 0.05 * across * (1 if variant % 2 else -1)
    opacity = side * start * end * dry
    return torch.stack([opacity, tone.clamp(-0.35, 0.35), (0.45 + 0.4 * hairs).clamp(0.05, 1)])


def loaded(variant: int) -> Tensor:
    """Draw a brush full of paste: round ends, a few furrows of uneven width, and paint pushed to both sides."""
    across, outside, t, along = _grid()
    furrows = gradient_noise(along / 30, across / 0.34, 1000 + variant)
    furrows = furrows + 0.6 * gradient_noise(along / 14, across / 0.15, 1100 + variant)
    rough = fractal_noise(along / 0.8, across / 0.25, 1200 + variant, 2)
    inside = 0.97 + 0.05 * rough + 0.1 * furrows - torch.hypot(across, outside)
    dry = ((1 - t) * 3 + 0.9 + 1.2 * furrows + 0.4 * rough).clamp(0, 1)
    tone = 0.22 * furrows + 0.04 * rough + 0.05 * across * (1 if variant % 2 else -1)
    film = 0.4 + 0.25 * furrows + 0.28 * torch.exp(-(((inside - 0.2) / 0.13) ** 2)) + 0.15 * (t - 0.5) + 0.03 * rough
    return torch.stack([(inside / 0.09).clamp(0, 1) * dry, tone.clamp(-0.3, 0.3), film.clamp(0.05, 1)])


def knife(variant: int) -> Tensor:
    """Draw a palette knife: a smooth film with straight sides, ridges pushed aside, and a torn end."""
    across, outside, t, along = _grid()
    drag = gradient_noise(along / 30, across / 0.6, 600 + variant)
    torn = fractal_noise(along / 0.5, across / 0.2, 700 + variant, 2)
    side = ((1.0 + 0.05 * torn + 0.06 * drag - across.abs()) / 0.05).clamp(0, 1)
    slant = 0.25 * across * (1 if variant % 2 else -1)  # the blade is set down and lifted askew
    start = ((0.5 + slant + 0.06 * drag + outside.clamp_max(0)) / 0.12).clamp(0, 1)
    end = ((0.35 + slant + 0.05 * torn + 0.1 * drag - outside.clamp_min(0)) / 0.16).clamp(0, 1)
    gaps = (2.6 + 1.0 * (1 - t) + 0.3 * torn + 0.6 * drag).clamp(0, 1)
    ridge = torch.exp(-(((across - (0.88 if variant % 2 else -0.88)) / 0.1) ** 2)) * (0.9 + drag).clamp_min(0)
    lip = torch.exp(-(((outside - 0.2 - slant) / 0.12) ** 2))
    streaks = gradient_noise(along / 20, across / 0.22, 650 + variant)
    film = 0.4 + 0.16 * drag + 0.06 * streaks + 0.6 * slant + 0.45 * ridge + 0.4 * lip
    tone = 0.2 * drag + 0.1 * streaks + 0.03 * torn
    return torch.stack([side * start * end * gaps, tone.clamp(-0.3, 0.3), film.clamp(0.05, 1)])


def wash(variant: int) -> Tensor:
    """Draw a loaded round brush on wet paper: a flat tint whose edge runs, and no height."""
    across, outside, t, along = _grid()
    runs = 0.15 * fractal_noise(along / 1.1, across / 1.1, 800 + variant, 2)
    inside = 0.92 + runs - torch.hypot(across, outside)
    return torch.stack([(inside / 0.08).clamp(0, 1), 0 * t, 0 * t])


def dab(variant: int) -> Tensor:
    """Draw a touch of the tip of a brush: a soft, uneven spot, thickest where the brush left it."""
    across, outside, t, _ = _grid()
    along = 0.7 * t + outside  # a dab is hardly longer than wide
    uneven = 0.16 * fractal_noise(along / 1.5, across / 1.5, 900 + variant, 2)
    inside = 0.95 + uneven - torch.hypot(across, outside)
    tone = 0.12 * gradient_noise(along / 3, across / 0.6, 950 + variant)
    return torch.stack([(inside / 0.36).clamp(0, 1), tone.clamp(-0.3, 0.3), 0.3 + 0.3 * t + 0.2 * inside.clamp(0, 1)])


DRAWN = {"chalk": chalk, "flat": flat, "loaded": loaded, "knife": knife, "wash": wash, "dab": dab}
