"""Write strokes as SVG (W3C, SVG 1.1): paths, outlines where the width tapers, and bitmaps where there is a texture."""

import base64
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
from torch import Tensor

from brushexp.bounds import between
from brushexp.compositing.profile import Profile, smooth_rise
from brushexp.plugins.export._sprites import Sprites, draw_sprites, has_sprites
from brushexp.plugins.export.base import Exporter, ExportJob
from brushexp.plugins.export.prints import bitmap
from brushexp.registry import register
from brushexp.shading.light import overlay
from brushexp.strokes.bezier import curve_of, half_width_of, point_at
from brushexp.strokes.saved import AT_ONCE
from brushexp.system.files import write_text

CRISP = 1.0  # pixels of soft edge of strokes whose renderer makes no profile
PIXEL = 1 / 12  # square pixels of variance of an edge that programs draw by the covered share of each pixel
BISECTIONS = 40  # halvings of the interval in which the width of an outline is searched
LIGHT_SIDE = 2048  # pixels of the longer side of the image of the light, at most
NAMESPACES = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
ALPHA_DIGITS = 3  # decimals of opacities
SIDE_POINTS, WEDGE_POINTS = 24, 12  # points on each long side of a stroke that tapers, and of one that only widens
ONE_COLOR = 1 / 255  # drift up to which a stroke is drawn in one colour
LEAST_SPREAD = 0.3  # of a curve to the side, over that along it, from which on its colours follow it there
EVEN = 0.02  # widening up to which a stroke is drawn as if it were as thick all along
PATH_EDGE = 3.0  # pixels of soft edge that one path makes, at most
MOST_PATHS = 5  # of a stroke
TURN = 1e-3  # a curve that folds is sampled so near to its sharpest bend, in the parameter, on either side
LEADING_ZERO = re.compile(r"(?<![\d.])0\.")  # SVG takes .5 for 0.5, and a minus without a space before it
FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")  # in XML 1.0


@register("to", "svg")
@dataclass(kw_only=True, eq=False)
class Svg(Exporter):
    """``strokes.svg``: one path per stroke, bottom first, that browsers and Inkscape show like the painting.

    A path is a curve with a width and round ends; where the thickness changes along the stroke it is a filled outline.
    Sizes are pixels of the canvas. Programs fill the pixels at an edge by the share that is covered, which is sharper
    than the soft edge of the renderer; two ``outlines`` come close to it, and a stroke with a softness of its own has
    more. A stroke thinner than its edge is drawn wider and fainter, as the renderer does. One whose colour drifts has a
    linear gradient. One that cannot be seen (no width, no opacity) has no path; one without length is a dot.

    Strokes with a texture are bitmaps with transparency, one image each, coarser than the picture where all would be
    too large; those of a slow renderer (``neural``) are paths without the texture. The lamp of a painting (``light.*``)
    and its paper are the last image, ``light``: what is darkened is covered with black, what paint skips with ground.

    Args:
        digits: decimals of coordinates and widths.
        outlines: how many paths, one on another, make the soft edge of a stroke; more where it is wider than 3 pixels.
        paths: nothing but paths, without textures and light, for programs that edit them.
    """

    digits: Annotated[int, between(0, 6)] = 2
    outlines: Annotated[int, between(1, 8)] = 1
    paths: bool = False

    def write(self, job: ExportJob, folder: Path, pictures: tuple[np.ndarray, np.ndarray] | None = None) -> list[Path]:
        """Write the file; ``pictures`` are those of the job without and under its lamp, if they exist already."""
        path = folder / "strokes.svg"
        write_text(path, self._lines(job, pictures))
        return [path]

    def _lines(self, job: ExportJob, pictures: tuple[np.ndarray, np.ndarray] | None) -> Iterator[str]:
        (height, width), count = job.size, len(job.strokes)
        profile, is_profile = profile_of(job)
        has_bitmaps, is_lit = not self.paths and has_sprites(job), not self.paths and not job.is_bare
        about = f"{count} brush strokes on {width} x {height} pixels, the bottom one first"
        about += f", from {job.source}" * bool(job.source) + "; written by brushexp."
        if has_bitmaps:
            about += " Each one is a bitmap with its texture."
        elif not is_profile:
            about += f" The renderer {job.saved.renderer} gives them a texture, which paths cannot hold."
        about += " Viewers mix its colours as light, not as color= said." * (not job.space.is_rgb)
        about += " The last image is the light on the paint." * is_lit
        canvas = f'<path d="M0 0h{width}v{height}h-{width}z"'
        stroked = ' fill="none" stroke-linecap="round" stroke-linejoin="round"'
        yield f'<?xml version="1.0" encoding="UTF-8"?>\n<svg version="1.1" {NAMESPACES} '
        yield f'width="{width}px" height="{height}px" viewBox="0 0 {width} {height}" '
        yield 'style="max-width:100%;max-height:100vh">\n'
        yield f"<title>{count} brush strokes</title>\n<desc>{escape(FORBIDDEN.sub('?', about), quote=False)}</desc>\n"
        yield f'<clipPath id="canvas">{canvas}/></clipPath>\n'
        if (alpha := job.at_most(LIGHT_SIDE).alpha()) is not None:
            place = f'x="0" y="0" width="{width}" height="{height}"'
            white = np.dstack([np.full((*alpha.shape[:2], 3), 255, np.uint8), alpha])
            yield f'<mask id="alpha" maskUnits="userSpaceOnUse" {place}>'
            yield f'<image {place} preserveAspectRatio="none" {_href(white)}/></mask>\n'
            stroked += ' mask="url(#alpha)"'
        yield f'<g clip-path="url(#canvas)"{stroked}>\n'
        yield f'{canvas} fill="{hexadecimal(job.saved.background[None])[0]}"/>\n'
        if has_bitmaps:
            yield from self._bitmaps(draw_sprites(job))
        else:
            for number in job.bottom_up.cpu().split(AT_ONCE):
                yield LEADING_ZERO.sub(".", "".join(self._paths(profile, number))).replace(" -", "-")
        if is_lit:
            if pictures is None or max(job.size) > LIGHT_SIDE:
                job = job.at_most(LIGHT_SIDE)
                pictures = job.bare().picture(), job.picture()
            light = _href(overlay(*pictures))
            yield f'<image id="light" width="{width}" height="{height}" preserveAspectRatio="none" {light}/>\n'
        yield "</g>\n</svg>\n"

    def _bitmaps(self, sprites: Sprites) -> Iterator[str]:
        for stroke, place, pixels in sprites.bitmaps():
            numbers = (*place, pixels.shape[1], pixels.shape[0])
            x, y, width, height = (f"{round(value / sprites.zoom, self.digits):.12g}" for value in numbers)
            shape = f'x="{x}" y="{y}" width="{width}" height="{height}"'
            yield f'<image id="stroke-{stroke}" {shape} preserveAspectRatio="none" {_href(pixels)}/>\n'

    def _paths(self, profile: Profile, number: Tensor) -> Iterator[str]:
        rows = {name: getattr(profile, name).detach().cpu()[number].double() for name in Profile.per_stroke}
        changes = (rows["widening"].abs() > EVEN) | (profile.taper > 0)
        counts = ((profile.soft + rows["softness"]) / PATH_EDGE).clamp(1, MOST_PATHS).ceil().long()
        counts = counts.clamp_min(self.outlines)
        texts = [""] * len(number)
        for count in counts.unique().tolist():
            for filled in (False, True):
                if not len(alike := ((counts == count) & (changes == filled)).nonzero()[:, 0]):
                    continue
                part = Profile(soft=profile.soft, taper=profile.taper, **{k: v[alike] for k, v in rows.items()})
                drawn = self._drawn(part, number[alike], count, filled=filled)
                for index, text in zip(alike.tolist(), drawn, strict=True):
                    texts[index] = text
        yield from texts

    def _drawn(self, profile: Profile, number: Tensor, count: int, *, filled: bool) -> Iterator[str]:
        """Draw each stroke by ``count`` paths, one on another: outlines that are ``filled``, or curves with a width.

        Those whose colour drifts have a gradient named by their ``number`` (N,).
        """
        middle, offset, alpha = soft_edge(profile.half_width, profile.opacity, profile.soft + profile.softness, count)
        widths = _round(2 * (middle[:, None] + offset), self.digits).tolist()
        kind = "fill" if filled else "stroke"
        shapes: Iterable[list[str]] = ([text] * count for text in curve_paths(profile.curve, self.digits))
        if filled:
            shapes = outline_paths(profile, middle, offset, self.digits)
        paints = gradients(profile, number, self.digits)
        rows = zip(shapes, paints, widths, _round(alpha, ALPHA_DIGITS).tolist(), strict=True)
        for paths, (gradient, paint), path_widths, opacities in rows:
            text = gradient
            for d, width, opaque in zip(paths, path_widths, opacities, strict=True):
                if width > 0 and opaque > 0:
                    more = "" if filled else f' stroke-width="{width:.12g}"'
                    more += "" if opaque == 1 else f' {kind}-opacity="{opaque:.12g}"'
                    text += f'<path d="{d}" {kind}="{paint}"{more}/>\n'
            yield text


def _href(pixels: np.ndarray) -> str:
    """Embed a picture (H, W, 4) uint8 in the attribute that shows it: SVG 1.1 knows no ``href`` but that of XLink."""
    return f'xlink:href="data:image/png;base64,{base64.b64encode(bitmap(pixels)).decode()}"'


@torch.no_grad()
def profile_of(job: ExportJob) -> tuple[Profile, bool]:
    """Make profiles of strokes, and tell whether they are all that their renderer draws."""
    strokes = job.strokes
    if isinstance(job.renderer(strokes[:0]), Profile):  # no strokes are drawn to find out
        profile = job.renderer(strokes)
        assert isinstance(profile, Profile)
        return profile, True
    return Profile(curve_of(strokes), half_width_of(strokes), strokes.color, strokes.opacity, CRISP, 0.0), False


def soft_edge(half: Tensor, opacity: Tensor, soft: Tensor, count: int) -> tuple[Tensor, Tensor, Tensor]:
    """Choose strokes with hard edges, one on another, that together cover what a soft one does.

    One alone has the same opacity in its middle as the soft stroke, C(0) of `Profile`, and the same share of the light
    across it, so it is wider than a stroke that is thinner than the edge. Several have the half widths at which C(d)
    passes (k + 1/2) / count of C(0), drawn together so that, smoothed by a pixel, their edge is as soft as that of C:
    its variance is ``soft``^2 / 20 for a wide stroke. ``half`` (N,) and ``soft`` (N,), the edges' widths, are pixels.

    Returns:
        Half width of one stroke alone (N,); what to add to it (N, K), the widest first; opacities (N, K).
    """
    peak = 2 * smooth_rise(half / soft)
    middle = half / peak.clamp_min(torch.finfo(half.dtype).tiny)
    share = (opacity * peak / count)[:, None]
    alpha = share / (1 - share * torch.arange(count)).clamp_min(torch.finfo(half.dtype).tiny)
    if count == 1:
        return middle, torch.zeros_like(share), alpha
    distance = _distances(half, soft, count)
    wide = _distances(soft, soft, count).var(1, unbiased=False)
    closer = ((soft**2 / 20 - PIXEL) / wide).clamp_min(0).sqrt()[:, None]
    return middle, closer * (distance - distance.mean(1, keepdim=True)), alpha


def _distances(half: Tensor, soft: Tensor, count: int) -> Tensor:
    """Search by bisection where (N, count) C(d) has fallen to (k + 1/2) / count of C(0)."""
    high, half, soft = half + 0.5 * soft, half[:, None], soft[:, None]
    level = 2 * smooth_rise(half / soft) * (torch.arange(count) + 0.5) / count
    low, high = torch.zeros_like(level), high[:, None].expand_as(level)
    for _ in range(BISECTIONS):
        d = 0.5 * (low + high)
        inside = smooth_rise((half + d) / soft) + smooth_rise((half - d) / soft) > level
        low, high = torch.where(inside, d, low), torch.where(inside, high, d)
    return low


def hexadecimal(color: Tensor) -> list[str]:
    """Write colours (N, 3) in [0, 1] as ``#rrggbb``."""
    levels = (color * 255 + 0.5).clamp(0, 255).long().tolist()
    return [f"#{red:02x}{green:02x}{blue:02x}" for red, green, blue in levels]


def gradients(profile: Profile, number: Tensor, digits: int) -> Iterator[tuple[str, str]]:
    """Yield the linear gradient of each stroke, if its colour drifts, and the name of its paint.

    It changes with the place as best fits 2 t - 1 along the curve.
    """
    u = torch.linspace(-1, 1, WEDGE_POINTS).to(profile.curve)
    point = point_at(profile.curve[:, None], ((u + 1) / 2).expand(len(profile.curve), -1))
    middle = point.mean(1)
    slope = torch.linalg.pinv(point - middle[:, None], rtol=LEAST_SPREAD) @ u  # (N, 2) per pixel
    half = slope / slope.square().sum(1, keepdim=True)
    ends = torch.stack([middle - half, middle + half], dim=1)
    drifts = (profile.drift.abs().amax(1) > ONE_COLOR) & ends.isfinite().all((1, 2))
    colors = zip(*(hexadecimal(profile.color + k * profile.drift) for k in (0, -1, 1)), strict=True)
    rows = zip(drifts.tolist(), number.tolist(), _round(ends, digits).flatten(1).tolist(), colors, strict=True)
    for is_gradient, name, line, (plain, first, last) in rows:
        if not is_gradient:
            yield "", plain
            continue
        place = " ".join(f'{axis}="{at:.12g}"' for axis, at in zip(("x1", "y1", "x2", "y2"), line, strict=True))
        stops = f'<stop stop-color="{first}"/><stop offset="1" stop-color="{last}"/>'
        head = f'<linearGradient id="drift-{name}" gradientUnits="userSpaceOnUse" {place}>'
        yield f"{head}{stops}</linearGradient>\n", f"url(#drift-{name})"


def _numbers(*values: float) -> str:
    return " ".join(["%.12g"] * len(values)) % values


def curve_paths(curve: Tensor, digits: int) -> Iterator[str]:
    """Write quadratic Bezier curves (N, 3, 2); a point becomes a shortest line."""
    curve = _round(curve, digits)
    further = _round((curve[:, 1:] - curve[:, :1]).flatten(1), digits)
    for start, ends in zip(curve[:, 0].tolist(), further.tolist(), strict=True):
        yield f"M{_numbers(*start)}" + (f"q{_numbers(*ends)}" if any(ends) else f"h{_numbers(10**-digits)}")


def _round(values: Tensor, digits: int) -> Tensor:
    return values.round(decimals=digits) + 0.0  # not -0


def outline_paths(profile: Profile, middle: Tensor, offset: Tensor, digits: int) -> Iterator[list[str]]:
    """Outline strokes whose thickness changes, with round ends; fill them by the rule nonzero.

    The half width at parameter t is ``middle * (1 - taper * u^2) * (1 + widening * u) + offset`` with u = 2 t - 1, and
    0 where that is less. Sides are chains of chords. A curve that folds gets a disc where it does, and one that is a
    point is a disc. Yields the K outlines of each stroke; ``middle`` (N,) and ``offset`` (N, K) are in pixels.
    """
    curve, taper, widening = profile.curve, profile.taper, profile.widening[:, None]
    bend, folds = sharpest_bend(curve, middle)
    point_like = (curve - curve[:, :1]).abs().amax((1, 2)) * 10**digits < 1
    even = torch.linspace(0, 1, SIDE_POINTS if taper else WEDGE_POINTS).to(curve).expand(len(curve), -1)
    t = torch.cat([even, bend[:, None] - TURN, bend[:, None] + TURN], dim=1).clamp(0, 1).sort(1).values  # (N, T)
    point, normal = point_at(curve[:, None], t)[:, None], _normal(curve, t)[:, None]  # (N, 1, T, 2)
    along = 2 * torch.cat([t, bend[:, None]], dim=1) - 1
    half = middle[:, None] * (1 - taper * along**2) * (1 + widening * along)
    half = (half[:, None] + offset[..., None]).clamp_min(0)  # (N, K, T + 1), the last one at the bend
    reach = half[..., :-1, None] * normal
    sides = (point + reach).flatten(2), (point - reach).flip(2).flatten(2)  # (N, K, 2 T): x, y, x, y, ...
    tips = half[..., -1:] * (folds | point_like)[:, None, None]
    tables = (*sides, half[..., [0, -2]], tips, point_at(curve, bend))
    columns = [_round(table, digits).tolist() for table in tables]
    for lefts, rights, halves, discs, (x, y) in zip(*columns, strict=True):
        outlines = []
        for side, back, (first, last), (tip,) in zip(lefts, rights, halves, discs, strict=True):
            # Along one side, around the end, back along the other side and around the start.
            text = f"M{_numbers(*side)}A{_numbers(last, last)} 0 0 0 {_numbers(*back[:2])}L"
            text += f"{_numbers(*back[2:])}A{_numbers(first, first)} 0 0 0 {_numbers(*side[:2])}z"
            if tip > 0:
                arc = f"a{_numbers(tip, tip)} 0 1 0 "
                text += f"M{_numbers(x - tip, y)}{arc}{_numbers(2 * tip, 0)}{arc}{_numbers(-2 * tip, 0)}z"
            outlines.append(text)
        yield outlines


def sharpest_bend(curve: Tensor, half: Tensor) -> tuple[Tensor, Tensor]:
    """Find the parameter (N,) where curves (N, 3, 2) bend most, and whether more tightly than ``half`` their width."""
    start, control, end = curve.unbind(1)
    bend, forward = start - 2 * control + end, control - start
    at = -(forward * bend).sum(1) / bend.square().sum(1).clamp_min(torch.finfo(curve.dtype).tiny)
    inside = (at > 2 * TURN) & (at < 1 - 2 * TURN)
    at = at.clamp(0, 1)
    velocity = 2 * (forward + at[:, None] * bend)
    turn = 2 * (velocity[:, 0] * bend[:, 1] - velocity[:, 1] * bend[:, 0]).abs()
    return at, inside & (velocity.norm(dim=1) ** 3 <= turn * half)


def _normal(curve: Tensor, t: Tensor) -> Tensor:
    """Compute unit normals (N, T, 2) of curves (N, 3, 2) at t (N, T), and at the ends from beside them."""
    start, control, end = (point[:, None] for point in curve.unbind(1))
    beside = t.clamp(1e-4, 1 - 1e-4)[..., None]
    velocity = (1 - beside) * (control - start) + beside * (end - control)
    heading = velocity / velocity.norm(dim=-1, keepdim=True).clamp_min(torch.finfo(curve.dtype).tiny)
    return torch.stack([-heading[..., 1], heading[..., 0]], dim=-1)
