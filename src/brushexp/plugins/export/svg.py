"""Write strokes as SVG (W3C, SVG 1.1): paths, outlines for tapering strokes, and bitmaps for textured strokes."""

import base64
import logging
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
from brushexp.plugins.export._prints import bitmap
from brushexp.plugins.export._sprites import Sprites, draw_sprites, has_sprites
from brushexp.plugins.export._svg_groups import stroke_groups
from brushexp.plugins.export._svg_paths import curve_paths, gradients, hexadecimal, outline_paths, round_to
from brushexp.plugins.export.base import Exporter, ExportJob
from brushexp.registry import register
from brushexp.shading.light import overlay
from brushexp.strokes.bezier import curve_of, half_width_of
from brushexp.strokes.saved import AT_ONCE
from brushexp.system.files import write_text

log = logging.getLogger(__name__)
CRISP = 1.0  # soft edge, in pixels, of strokes whose renderer does not draw profiles
PIXEL = 1 / 12  # variance, in square pixels, of an edge that viewers antialias by pixel coverage
BISECTIONS = 40  # number of bisections in the search for the width of an outline
LIGHT_SIDE = 2048  # maximum number of pixels on the longer side of the image of the light
SAMPLED = 100  # number of bitmaps from which the total size is estimated
BASE64 = 4 / 3  # letters per byte
TAG = 130  # bytes for the place and number of a bitmap
INKSCAPE = ' xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"'
NAMESPACES = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
ALPHA_DIGITS = 3  # decimals of opacities
EVEN = 0.02  # largest widening of a stroke that is drawn with constant thickness
PATH_EDGE = 3.0  # widest soft edge that a single path represents, in pixels
MOST_PATHS = 5  # largest number of paths per stroke
LEADING_ZERO = re.compile(r"(?<![\d.])0\.")  # SVG allows .5 for 0.5, and no space before a minus
FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")  # forbidden in XML 1.0


@register("to", "svg")
@dataclass(kw_only=True, eq=False)
class Svg(Exporter):
    """Writes ``strokes.svg``: one path per stroke, bottom first; it looks like the painting in browsers and Inkscape.

    A path is a curve with a width and round ends, or a filled outline if the thickness changes along the stroke. Sizes
    are in pixels of the canvas. A single path has a sharper edge than the rendered stroke; two ``outlines`` approximate
    the soft edge closely, and strokes with additional softness get more outlines. A stroke thinner than its edge is
    drawn wider and fainter, as the renderer draws it. A drifting colour becomes a linear gradient. An invisible stroke
    (without width or opacity) has no path; a stroke without length is a dot.

    Textured strokes are bitmaps with transparency, one image per stroke, at a lower resolution than the picture if the
    file would be too large; strokes of a slow renderer (``neural``) are paths without texture. The last image,
    ``light``, contains the effects of the lamp (``light.*``) and of the paper: black over darkened areas, and the
    ground colour over areas that the paint skips.

    Args:
        digits: number of decimals of coordinates and widths.
        outlines: number of stacked paths that form the soft edge of a stroke; an edge wider than 3 pixels gets more.
        paths: whether to write paths only, without textures and light, for vector editors.
        layers: number of equal groups of strokes, bottom first, which Inkscape shows as layers; 0 = none.
        colors: number of colour groups in each layer, dark to light, which changes the order of strokes within a layer;
            0 = none.
        width_mm: width of the drawing in millimetres; null = sizes in pixels.
    """

    digits: Annotated[int, between(0, 6)] = 2
    outlines: Annotated[int, between(1, 8)] = 1
    paths: bool = False
    layers: Annotated[int, between(0, 100)] = 0
    colors: Annotated[int, between(0, 100)] = 0
    width_mm: Annotated[float, between(1, 100_000, typical=200)] | None = None

    @property
    def is_grouped(self) -> bool:
        return bool(self.layers or self.colors)

    def write(self, job: ExportJob, folder: Path, pictures: tuple[np.ndarray, np.ndarray] | None = None) -> list[Path]:
        """Write the file; ``pictures`` are the job's unlit and lit pictures, if they have already been painted."""
        path = folder / "strokes.svg"
        has_bitmaps = not self.paths and has_sprites(job)
        sprites = draw_sprites(job) if has_bitmaps else None
        if sprites is not None and pictures is None:  # a painting writes this file without being asked
            size = megabytes_of(sprites)
            log.info(
                "strokes.svg: about %.1f MB of %s bitmaps; %s.paths=true writes paths",
                size,
                len(sprites.number),
                self.key,
            )
        write_text(path, self._lines(job, sprites, pictures))
        return [path]

    def _lines(
        self,
        job: ExportJob,
        sprites: Sprites | None,
        pictures: tuple[np.ndarray, np.ndarray] | None,
    ) -> Iterator[str]:
        (height, width), count = job.size, len(job.strokes)
        profile, is_profile = profile_of(job)
        is_lit = not self.paths and not job.is_bare
        about = f"{count} brush strokes on {width} x {height} pixels, bottom stroke first"
        about += f", from {job.source}" * bool(job.source) + "; written by brushexp."
        if sprites is not None:
            about += " Each stroke is a bitmap with its texture."
        elif not is_profile:
            about += f" The renderer {job.saved.renderer} gives them a texture, which paths cannot hold."
        about += " Viewers mix colours as light, not by the color= of the painting." * (not job.space.is_rgb)
        about += " The last image is the light on the paint." * is_lit
        canvas = f'<path d="M0 0h{width}v{height}h-{width}z"'
        stroked = ' fill="none" stroke-linecap="round" stroke-linejoin="round"'
        across, up, unit = f"{width:.12g}", f"{height:.12g}", "px"
        if self.width_mm is not None:
            scale = self.width_mm / width
            across, up, unit = f"{self.width_mm:.12g}", f"{height * scale:.6g}", "mm"
            stroked += f' transform="scale({scale:.9g})"'
        namespaces = NAMESPACES + INKSCAPE * self.is_grouped
        yield f'<?xml version="1.0" encoding="UTF-8"?>\n<svg version="1.1" {namespaces} '
        yield f'width="{across}{unit}" height="{up}{unit}" viewBox="0 0 {across} {up}" '
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
        yield from self._strokes(job, profile, sprites)
        if is_lit:
            if pictures is None or max(pictures[0].shape) > LIGHT_SIDE:
                job = job.at_most(LIGHT_SIDE)
                pictures = job.bare().picture(), job.picture()
            light = _href(overlay(*pictures))
            yield f'<image id="light" width="{width}" height="{height}" preserveAspectRatio="none" {light}/>\n'
        yield "</g>\n</svg>\n"

    def _strokes(self, job: ExportJob, profile: Profile, sprites: Sprites | None) -> Iterator[str]:
        """Write all strokes, bottom first, in groups."""
        if not self.is_grouped:
            yield from self._drawn_strokes(job.bottom_up.cpu(), profile, sprites)
            return
        layer = 0
        for group in stroke_groups(job, self.layers, self.colors):
            if group.layer != layer:
                yield "</g>\n" * bool(layer)
                yield _opening_tag(f"layer-{group.layer}", f"layer {group.layer}")
                layer = group.layer
            if group.color is not None:
                yield _opening_tag(f"layer-{layer}-{group.color[1:]}", group.color)
            yield from self._drawn_strokes(group.number, profile, sprites)
            yield "</g>\n" * (group.color is not None)
        yield "</g>\n" * bool(layer)

    def _drawn_strokes(self, number: Tensor, profile: Profile, sprites: Sprites | None) -> Iterator[str]:
        """Write the strokes with indices ``number`` (n,), in the given order."""
        if sprites is not None:
            yield from self._bitmaps(sprites, number)
            return
        for some in number.split(AT_ONCE):
            yield LEADING_ZERO.sub(".", "".join(self._paths(profile, some))).replace(" -", "-")

    def _bitmaps(self, sprites: Sprites, number: Tensor) -> Iterator[str]:
        for stroke, place, pixels in sprites.bitmaps(number.numpy()):
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
                drawn = self._write_strokes(part, number[alike], count, filled=filled)
                for index, text in zip(alike.tolist(), drawn, strict=True):
                    texts[index] = text
        yield from texts

    def _write_strokes(self, profile: Profile, number: Tensor, count: int, *, filled: bool) -> Iterator[str]:
        """Write each stroke as ``count`` stacked paths, which are ``filled`` outlines or curves with a width.

        A stroke with a drifting colour refers to a gradient named after its index in ``number`` (N,).
        """
        middle, offset, alpha = soft_edge(profile.half_width, profile.opacity, profile.soft + profile.softness, count)
        widths = round_to(2 * (middle[:, None] + offset), self.digits).tolist()
        kind = "fill" if filled else "stroke"
        shapes: Iterable[list[str]] = ([text] * count for text in curve_paths(profile.curve, self.digits))
        if filled:
            shapes = outline_paths(profile, middle, offset, self.digits)
        paints = gradients(profile, number, self.digits)
        rows = zip(shapes, paints, widths, round_to(alpha, ALPHA_DIGITS).tolist(), strict=True)
        for paths, (gradient, paint), path_widths, opacities in rows:
            text = ""
            for d, width, opaque in zip(paths, path_widths, opacities, strict=True):
                if width > 0 and opaque > 0:
                    more = "" if filled else f' stroke-width="{width:.12g}"'
                    more += "" if opaque == 1 else f' {kind}-opacity="{opaque:.12g}"'
                    text += f'<path d="{d}" {kind}="{paint}"{more}/>\n'
            yield gradient + text if text else ""


def _opening_tag(name: str, label: str) -> str:
    """Write the opening tag of a group that Inkscape shows as a layer with this label."""
    return f'<g id="{name}" inkscape:groupmode="layer" inkscape:label="{label}">\n'


def megabytes_of(sprites: Sprites) -> float:
    """Estimate the total size of the bitmaps in an SVG from a few of them."""
    areas = sprites.boxes[:, 2:].prod(1)
    some = sprites.number[:: max(1, len(sprites.number) // SAMPLED)]
    packed = pixels = 0
    for _, _, one in sprites.bitmaps(some):
        packed += len(bitmap(one))
        pixels += one.shape[0] * one.shape[1]
    return (BASE64 * packed / max(pixels, 1) * float(areas.sum()) + TAG * len(areas)) / 1e6


def _href(pixels: np.ndarray) -> str:
    """Embed a uint8 picture (H, W, 4) in an XLink ``href`` attribute, the only kind that SVG 1.1 has."""
    return f'xlink:href="data:image/png;base64,{base64.b64encode(bitmap(pixels)).decode()}"'


@torch.no_grad()
def profile_of(job: ExportJob) -> tuple[Profile, bool]:
    """Approximate the strokes by profiles, and return whether the profiles match the rendered strokes."""
    strokes = job.strokes
    if isinstance(job.renderer(strokes[:0]), Profile):  # checked without drawing strokes
        profile = job.renderer(strokes)
        assert isinstance(profile, Profile)
        return profile, True
    return Profile(curve_of(strokes), half_width_of(strokes), strokes.color, strokes.opacity, CRISP, 0.0), False


def soft_edge(half: Tensor, opacity: Tensor, soft: Tensor, count: int) -> tuple[Tensor, Tensor, Tensor]:
    """Approximate a stroke with a soft edge by stacked strokes with hard edges that together cover the same area.

    A single stroke has the same opacity in the middle as the soft stroke, C(0) of `Profile`, and blocks the same total
    amount of light across its width. It is therefore wider than a soft stroke that is thinner than its edge. Several
    strokes have the half widths at which C(d) falls to (k + 1/2) / count of C(0). These half widths are moved closer
    together so that, after smoothing by a pixel, the edge is as soft as the edge of C, whose variance is
    ``soft``^2 / 20 for a wide stroke. ``half`` (N,) and the edge widths ``soft`` (N,) are in pixels.

    Returns:
        Half width (N,) of a single stroke; offsets (N, K) from it, widest first; opacities (N, K).
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
    """Find, by bisection, the distances (N, count) at which C(d) has fallen to (k + 1/2) / count of C(0)."""
    high, half, soft = half + 0.5 * soft, half[:, None], soft[:, None]
    level = 2 * smooth_rise(half / soft) * (torch.arange(count) + 0.5) / count
    low, high = torch.zeros_like(level), high[:, None].expand_as(level)
    for _ in range(BISECTIONS):
        d = 0.5 * (low + high)
        inside = smooth_rise((half + d) / soft) + smooth_rise((half - d) / soft) > level
        low, high = torch.where(inside, d, low), torch.where(inside, high, d)
    return low
