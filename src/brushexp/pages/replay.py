"""Pack each stroke into a few bytes, so that a canvas on a page can redraw it."""

import base64
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch

from brushexp.compositing.layers import SPREAD
from brushexp.compositing.textured_profile import TexturedProfile
from brushexp.compositing.textures import BYTE, HALF, TEXEL_ASPECT, Sheets
from brushexp.pictures.color import hex_of
from brushexp.plugins.export.base import ExportJob
from brushexp.plugins.export.svg import profile_of
from brushexp.results.stroke_table import StrokeTable
from brushexp.strokes.bezier import curve_of, half_width_of
from brushexp.strokes.catalogue import LATER_FIELDS

MAX_STROKES = 200_000  # largest number of strokes that browsers draw smoothly
LEVELS = 65_535  # largest 16-bit number
FARTHEST_CANVAS_SIDES = 4.0  # canvas sides, beyond which control points are clamped
CANVAS_RENDERER = "analytic"  # renderer whose strokes a canvas can draw
Columns = Mapping[str, tuple[np.ndarray, float, float]]  # (N, ...) values and their range


def replay_of(job: ExportJob, measures: StrokeTable) -> dict[str, Any] | None:
    """Pack strokes with their measures and textures; return None if there are more than ``MAX_STROKES`` strokes.

    Returns the dictionary from `pack_strokes` and adds the result of `pack_textures` as ``texture``. ``direction`` is
    -1 for strokes without a direction; ``layer`` is the tercile (0 to 2) of the stroke's area.
    """
    if len(job.strokes) > MAX_STROKES:
        return None
    far = FARTHEST_CANVAS_SIDES * max(job.size)
    length, thirds = measures.length.clip(0, 2 * far), np.quantile(measures.area, [1 / 3, 2 / 3])
    about = {
        "length": (length, 0, length.max()),
        "direction": (np.nan_to_num(np.degrees(measures.orientation), nan=-1), -1, 180),
        "visible": (measures.visible, 0, 1),
        "layer": (np.searchsorted(thirds, measures.area), 0, LEVELS),
    }
    textured = textured_profile_of(job)
    looks = None if textured is None else np.unique(textured.look.numpy())
    texture = None if textured is None or looks is None else pack_textures(textured.sheets, looks)
    return pack_strokes(job, about, looks) | {"texture": texture}


def pack_strokes(job: ExportJob, about: Columns | None = None, looks: np.ndarray | None = None) -> dict[str, Any]:
    """Pack a painting without its textures for ``strokes.js``; ``about`` adds columns of stroke data.

    ``data`` holds little-endian arrays in base64, one after another, each ordered from the bottom stroke to the top.
    The first array holds each stroke's index in the catalogue (uint32). Each later array holds one of ``columns``
    (name, values per stroke, lowest and highest value) as fractions of its range (uint16). ``points`` are the control
    points, and ``half`` is half the width. Strokes drawn as a `Profile` also have ``softness`` in pixels, ``widening``
    and ``drift``; a column that is 0 for all strokes is omitted. Textured strokes have ``thick`` and ``strength``, the
    half width and opacity at which they are rendered, and ``texture_of``: the number of the texture, how often its loop
    is repeated, and whether it is flipped. Textures are numbered by their positions in the sorted ``looks``, or among
    all textures if ``looks`` is None.
    """
    count, saved, (height, width) = len(job.strokes), job.saved, job.size
    textured = textured_profile_of(job)
    far = FARTHEST_CANVAS_SIDES * max(height, width)
    points = curve_of(saved.strokes).numpy().clip(-far, max(height, width) + far)
    half = half_width_of(saved.strokes).numpy().clip(0, far)
    values: dict[str, tuple[np.ndarray, float, float]] = {  # (N, ...), lowest and highest value
        "points": (points, points.min(initial=0), points.max(initial=0)),
        "half": (half, 0, half.max(initial=0)),
        "paint": (saved.strokes.color.numpy(), 0, 1),
        "opacity": (saved.strokes.opacity.numpy(), 0, 1),
    } | dict(about or {})
    drawn, _ = profile_of(job)
    if textured is None:
        for name in LATER_FIELDS:
            if (field := getattr(drawn, name).clamp(-far, far)).any():
                values[name] = field.numpy(), min(0.0, float(field.min())), max(0.0, float(field.max()))
    else:
        thick, strength = textured.half_width.numpy().clip(0, far), textured.opacity.numpy()
        look = textured.look.numpy() if looks is None else np.searchsorted(looks, textured.look.numpy())
        chosen = np.stack([look, textured.repeats.numpy(), textured.flip.numpy() < 0], axis=1)
        values |= {
            "thick": (thick, 0, thick.max(initial=0)),
            "strength": (strength, 0, 1),
            "texture_of": (chosen, 0, LEVELS),
        }
    order = saved.depth.argsort().numpy()
    columns, data = [], order.astype("<u4").tobytes()
    for name, (column, low, high) in values.items():
        shares = (column[order].astype(np.float64) - low) / max(high - low, 1e-6)
        data += _quantise(shares, LEVELS, "<u2").tobytes()
        columns.append((name, column[:1].size or 1, float(low), float(max(high, low + 1e-6))))
    mixed = not job.space.is_rgb
    return {
        "count": count,
        "width": width,
        "height": height,
        "background": hex_of(saved.background.numpy()),
        "soft": drawn.soft,
        "taper": drawn.taper,
        "exact": (saved.renderer == CANVAS_RENDERER or textured is not None) and not mixed,
        "mixed": mixed,
        "columns": columns,
        "data": base64.b64encode(data).decode(),
    }


def pack_textures(sheets: Sheets, looks: np.ndarray) -> dict[str, Any]:
    """Pack the textures with indices ``looks`` (M,) for a page.

    ``texels`` is encoded in base64, with one byte each for opacity and tone. Each entry of ``sheets`` describes a
    texture: its first texel, its rows and columns, the start and length of its loop in columns, and the distance, in
    half widths, beyond which it is empty.
    """
    levels = np.stack([sheets.texels[:, 0].numpy() * BYTE, sheets.texels[:, 1].numpy() * HALF + 128], axis=1)
    size, loop, extent = (part[looks] for part in (sheets.size, sheets.loop, sheets.extent))
    counts = (size + 2).prod(1).numpy()
    parts = [levels[first : first + count] for first, count in zip(sheets.first[looks].tolist(), counts, strict=True)]
    texels = np.concatenate([np.empty((0, 2)), *parts])
    rows = zip(counts.cumsum() - counts, size, loop, extent, strict=True)
    return {
        "spread": SPREAD,
        "long": TEXEL_ASPECT,
        "texels": base64.b64encode(texels.round().astype("u1").tobytes()).decode(),
        "sheets": [
            [int(first), *size.tolist(), float(begin) + 0.5, float(length), float(extent)]
            for first, size, (begin, length), extent in rows
        ],
    }


@torch.no_grad()
def textured_profile_of(job: ExportJob) -> TexturedProfile | None:
    """Lay out the textures along the strokes; return None if the renderer is slow or does not use textures."""
    layers = None if job.renderer.warm_up else job.renderer(job.strokes)
    return layers if isinstance(layers, TexturedProfile) else None


def _quantise(values: np.ndarray, steps: int, kind: str) -> np.ndarray:
    """Quantise numbers in [0, 1] to integers from 0 to ``steps``; NaN becomes 0."""
    return (np.nan_to_num(values).clip(0, 1) * steps + 0.5).astype(kind)  # halves round up, as in files.to_bytes
