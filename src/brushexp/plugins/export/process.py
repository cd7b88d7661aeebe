"""The painting being painted: its strokes laid down from the bottom to the top, as a film."""

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

from brushexp.bounds import between, one_of
from brushexp.compositing.bands import cuts
from brushexp.pictures.video import filming, largest_side
from brushexp.plugins.export.base import Exporter, ExportJob
from brushexp.registry import register
from brushexp.shading.height import Impasto, typical_width
from brushexp.shading.light import normals_of, shaded
from brushexp.strokes.bezier import unfinished
from brushexp.system.files import to_bytes
from brushexp.system.progress import with_progress

log = logging.getLogger(__name__)
GROWTH = 0.25  # seconds from the beginning of a stroke to its end


@register("to", "process")
@dataclass(kw_only=True)
class Process(Exporter):
    """``process.mp4`` or ``process.gif``: how the strokes are laid down, bottom to top, at the size of ``resolution``.

    A video has at most 4096 pixels on its longer side, a GIF 480; larger paintings are drawn at that size.

    Args:
        seconds: how long the painting takes.
        fps: pictures per second.
        format: mp4 (a GIF where PyAV is missing), gif, or both.
        hold: seconds that the finished painting stays.
        pace: even lays as many strokes in every second; quickening begins slowly, while strokes are large.
        growing: draw each stroke from its start to its end instead of laying it at once; null: unless the renderer is
            slow, because a stroke is drawn about seven times then.
    """

    seconds: Annotated[float, between(0.1, 300)] = 10.0
    fps: Annotated[int, between(1, 50)] = 25
    format: Annotated[str, one_of("mp4", "gif", "both")] = "mp4"
    hold: Annotated[float, between(0, 300)] = 1.5
    pace: Annotated[str, one_of("even", "quickening")] = "quickening"
    growing: bool | None = None

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        job, frames = fitted(job, largest_side(self.format)), max(1, round(self.seconds * self.fps))
        growing = job.renderer.warm_up is None if self.growing is None else self.growing
        shares = schedule(len(job.strokes), frames, self.seconds, self.pace, growing=growing)
        pictures = with_progress(lit_states(job, shares), frames, "pictures")
        with filming(folder / "process", self.format, job.size, Fraction(self.fps)) as film:
            for k, picture in enumerate(pictures, start=1):
                film.show(to_bytes(picture), 1 + (round(self.hold * self.fps) if k == frames else 0))
        return film.paths


def schedule(n: int, frames: int, seconds: float, pace: str, *, growing: bool) -> Iterator[np.ndarray]:
    """How much (n,) in [0, 1] of each stroke, the bottom one first, is in each frame: first nothing, at last all."""
    growth = min(GROWTH, 0.5 * seconds)
    share = np.arange(n) / max(n, 1)
    begin = (seconds - growth) * (share if pace == "even" else np.sqrt(share))
    for now in np.linspace(0, seconds, frames) if frames > 1 else [seconds]:
        drawn = np.clip((now - begin) / growth, 0, 1)
        yield drawn if growing else np.floor(drawn)


def fitted(job: ExportJob, side: int) -> ExportJob:
    """The same painting with at most ``side`` pixels on its longer side, which is told if it had more."""
    small = job.at_most(side)
    if small is not job:
        log.info("the film is drawn with %d x %d pixels, the most that it can have", small.size[1], small.size[0])
    return small


def lit_states(job: ExportJob, shares: Iterable[np.ndarray]) -> Iterator[Tensor]:
    """What `states` shows, under the painting's lamp: heights are laid over each other as colours are."""
    if not job.light.depth:
        yield from states(job, shares)
        return
    impasto = Impasto(job.renderer, typical_width(job.strokes))
    relief = replace(job, renderer=impasto, blend=job.blend.plain, background=torch.zeros_like(job.background))
    for_colors, for_heights = tee(shares)
    for color, height in zip(states(job, for_colors), states(relief, for_heights), strict=True):
        normals = normals_of(height[0].cpu().numpy(), job.light.depth)
        yield torch.from_numpy(shaded(color.float().cpu().numpy(), normals, job.light))


@torch.no_grad()
def states(job: ExportJob, shares: Iterable[np.ndarray]) -> Iterator[Tensor]:
    """The canvas (3, H, W), to be looked at before the next one is asked for, with ``shares`` of each stroke on it.

    Shares (N,) fall from 1 to 0 from the bottom stroke up, and never from state to state. Finished strokes are laid
    over what is there, so that each is drawn once, unless the blend is not `layered`.
    """
    space, bare = job.blend.space, job.background
    bare = bare if space is None else space.encode(bare)
    canvas, order, done = bare[:, None, None].repeat(1, *job.size), job.bottom_up, 0
    if not job.blend.layered:
        log.warning("with this blend every picture is drawn from the beginning, which takes long; try blend=tiled")
    for share in shares:
        finished, begun = (int(some.sum()) for some in (share >= 1, share > 0))
        if job.blend.layered:
            lay(canvas, order[done:finished], job)
            done = finished
        shown = canvas
        if begun > done:
            shown = canvas.clone()
            lay(shown, order[done:begun], job, torch.from_numpy(share[done:begun]))
        yield shown if space is None else space.decode(shown)


def lay(canvas: Tensor, number: Tensor, job: ExportJob, share: Tensor | None = None) -> None:
    """Lay ``share`` (n,) of strokes ``number`` (n,), the bottom one first, over a canvas (C, H, W), in place.

    It is in the channels of the painting's colour space. On black a blend shows what the strokes contribute, on white
    also what they let through: white light.
    """
    if not len(number):
        return
    strokes, black, white = job.strokes[number], canvas.new_zeros(len(canvas)), canvas.new_ones(len(canvas))
    if share is not None:
        strokes = unfinished(strokes, share.to(strokes.start))
    for top, rows, part in cuts(strokes, job.size, job.renderer):
        layers = job.renderer(strokes[part].moved(shift=(0, -top)))
        layers = layers if job.blend.space is None else layers.encoded(job.blend.space.encode)
        above, size = torch.arange(len(part), device=part.device).flip(0), (rows, job.size[1])
        painted = job.blend.plain(layers, above, size, black).image
        light = (job.blend.plain(layers, above, size, white).image - painted).mean(0)
        canvas[:, top : top + rows].mul_(light).add_(painted)
