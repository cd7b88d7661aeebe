"""Make a film of the painting process, in which strokes are added from bottom to top."""

import logging
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import tee
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
from torch import Tensor

from brushexp.contracts import between, one_of, register
from brushexp.contracts.families import Blend, ColorSpace, Exporter, ExportJob, Rows
from brushexp.contracts.files import to_bytes, with_progress
from brushexp.contracts.layers import Drawer, Impasto, cuts, normals_of, shade_picture, surface_height, typical_width
from brushexp.contracts.members import Rgb, profile_of
from brushexp.contracts.pictures import filming, largest_side
from brushexp.contracts.strokes import LATER_FIELDS, Strokes, truncate

log = logging.getLogger(__name__)
GROWTH = 0.25  # seconds from the beginning of a stroke to its end


@register("to", "process")
@dataclass(kw_only=True)
class Process(Exporter):
    """Writes ``process.mp4`` or ``process.gif``: a film of the strokes being painted, bottom to top, at ``resolution``.

    The longer side has at most 4096 pixels in a video and 480 in a GIF; larger paintings are drawn at this size.

    Args:
        seconds: duration of the painting in seconds.
        fps: frames per second.
        format: format of the film: mp4 (replaced by gif if PyAV is not installed) or gif.
        hold: time for which the finished painting is shown, in seconds.
        pace: pace of the strokes: even paints the same number of strokes every second; quickening starts slowly,
            with large strokes.
        growing: whether each stroke grows from start to end instead of appearing at once; a growing stroke is drawn
            about seven times. null = yes, unless the renderer is slow.
    """

    seconds: Annotated[float, between(0.1, 300)] = 10.0
    fps: Annotated[int, between(1, 50)] = 25
    format: Annotated[str, one_of("mp4", "gif")] = "mp4"
    hold: Annotated[float, between(0, 300)] = 1.5
    pace: Annotated[str, one_of("even", "quickening")] = "quickening"
    growing: bool | None = None

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        job, frames = shrink_to_side(job, largest_side(self.format)), max(1, round(self.seconds * self.fps))
        growing = job.renderer.warm_up is None if self.growing is None else self.growing
        shares = schedule(len(job.strokes), frames, self.seconds, self.pace, growing=growing)
        pictures = with_progress(states(job, shares), frames, "pictures")
        with filming(folder / "process", self.format, job.size, Fraction(self.fps)) as film:
            for k, picture in enumerate(pictures, start=1):
                film.show(to_bytes(picture), 1 + (round(self.hold * self.fps) if k == frames else 0))
        return [film.path]


def schedule(n: int, frames: int, seconds: float, pace: str, *, growing: bool) -> Iterator[np.ndarray]:
    """Yield, for each frame, the fraction (n,) of each stroke that is drawn, bottom stroke first, until all are 1."""
    growth = min(GROWTH, 0.5 * seconds)
    share = np.arange(n) / max(n, 1)
    begin = (seconds - growth) * (share if pace == "even" else np.sqrt(share))
    for now in np.linspace(0, seconds, frames) if frames > 1 else [seconds]:
        shares = np.clip((now - begin) / growth, 0, 1)
        yield shares if growing else np.floor(shares)


def shrink_to_side(job: ExportJob, side: int) -> ExportJob:
    """Shrink a painting whose longer side exceeds ``side`` pixels, and log the new size."""
    small = job.at_most(side)
    if small is not job:
        log.info("the film has %d x %d pixels, the maximum size", small.size[1], small.size[0])
    return small


def states(job: ExportJob, shares: Iterable[np.ndarray]) -> Iterator[Tensor]:
    """Yield the canvas (3, H, W) for each array in ``shares``: the fraction of each stroke that is drawn.

    A canvas may overwrite the previous one. It shows the painting's paper and light; the heights of strokes are
    composited like their colours.
    """
    if not job.blend.layered:
        log.warning("with this blend every frame is drawn from scratch, which is slow; try blend=tiled")
    background, rows = job.saved.background, Rows(0, job.size[0], job.size)
    shares, again = tee(shares)
    colors = (job.on_paper(rows, flat) for flat in _lay_in_steps(job, shares, background, job.renderer, job.space))
    if not job.light.depth:
        yield from colors
        return
    ground = None if job.paper is None else job.paper.relief(rows).numpy()
    typical = typical_width(job.strokes)
    impasto = Impasto(job.renderer, typical)
    heights = _lay_in_steps(job, again, torch.zeros_like(background), impasto, Rgb())
    for color, height in zip(colors, heights, strict=True):
        paint = height[0].cpu().numpy()
        surface = paint if ground is None else surface_height(paint, ground, typical)
        normals = normals_of(surface, job.light.depth)
        yield torch.from_numpy(shade_picture(color.float().cpu().numpy(), normals, job.light))


@torch.no_grad()
def _lay_in_steps(
    job: ExportJob, shares: Iterable[np.ndarray], bare: Tensor, renderer: Drawer, space: ColorSpace
) -> Iterator[Tensor]:
    """Yield pictures (3, H, W) of a job's strokes, drawn up to the fractions ``shares``, on the ``bare`` colour (3,).

    Within a state, the fractions (N,) decrease from 1 to 0 from the bottom stroke upwards; from one state to the next,
    no stroke's fraction decreases. If the blend is `layered`, finished strokes are composited onto the paint below, so
    that each is drawn only once.
    """
    canvas, bottom = space.encode(bare)[:, None, None].repeat(1, *job.size), 0
    strokes = job.strokes[job.bottom_up]
    if not profile_of(job)[1]:  # its renderer ignores these, and they differ for a part of a stroke
        strokes = replace(strokes, **dict.fromkeys(LATER_FIELDS))  # type: ignore[arg-type]
    for share in shares:
        finished, begun = (int(some.sum()) for some in (share >= 1, share > 0))
        if job.blend.layered:
            _lay(canvas, strokes[bottom:finished], renderer, job.blend, space)
            bottom = finished
        picture = canvas
        if begun > bottom:
            picture = canvas.clone()
            growing = torch.from_numpy(share[bottom:begun]).to(strokes.start)
            _lay(picture, truncate(strokes[bottom:begun], growing), renderer, job.blend, space)
        yield space.decode(picture)


def _lay(canvas: Tensor, strokes: Strokes, renderer: Drawer, blend: Blend, space: ColorSpace) -> None:
    """Composite strokes, bottom first, onto a canvas (C, H, W) in place, in the channels of the colour space.

    The blend over black gives the strokes' own contribution; the blend over white adds the light that they transmit.
    """
    if not len(strokes):
        return
    black, white = canvas.new_zeros(len(canvas)), canvas.new_ones(len(canvas))
    for top, rows, part in cuts(strokes, (canvas.shape[1], canvas.shape[2]), renderer):
        layers = renderer(strokes[part].moved(shift=(0, -top)))
        layers = layers if space.is_rgb else layers.encoded(space.encode)
        above, size = torch.arange(len(part), device=part.device).flip(0), (rows, canvas.shape[2])
        paint = blend(layers, above, size, black).image
        light = (blend(layers, above, size, white).image - paint).mean(0)
        canvas[:, top : top + rows].mul_(light).add_(paint)
