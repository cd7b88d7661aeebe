"""The painting being painted: its strokes laid down from the bottom to the top, as a film."""

import logging
from collections.abc import Iterable, Iterator
from dataclasses import replace
from enum import Enum
from fractions import Fraction
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
from torch import Tensor

from brushexp.bounds import between
from brushexp.compositing.bands import cuts
from brushexp.pictures.video import Format, filming, largest_side
from brushexp.plugins.export.base import Exporter, ExportJob
from brushexp.registry import register
from brushexp.strokes.catalogue import Strokes
from brushexp.system.files import to_bytes
from brushexp.system.progress import with_progress

log = logging.getLogger(__name__)
GROWTH = 0.25  # seconds from the beginning of a stroke to its end
PROBES = 64  # strokes on which a blend is tried
PROBE_SIDE = 32  # pixels of the canvas for it
PROBE_OPACITY = 0.1  # of each: the lowest still shows
LEVEL = 1 / 255


class Pace(Enum):
    """Strokes per second: as many all the time, or few at first, when they are large, and ever more."""

    even = "even"
    quickening = "quickening"


@register("to", "process")
class Process(Exporter):
    """``process.mp4`` or ``process.gif``: how the strokes are laid down, bottom to top, at the size of ``resolution``.

    A video has at most 4096 pixels on its longer side, a GIF 480; larger paintings are drawn at that size.

    Args:
        seconds: how long the painting takes, up to 300.
        fps: pictures per second, 1 to 50.
        format: mp4 (a GIF where PyAV is missing), gif, or both.
        hold: seconds that the finished painting stays, up to 300.
        pace: even lays as many strokes in every second; quickening begins slowly, while strokes are large.
        growing: draw each stroke from its start to its end instead of laying it at once; null: unless the renderer is
            slow, because a stroke is drawn about seven times then.
    """

    def __init__(
        self,
        *,
        seconds: Annotated[float, between(0.1, 300)] = 10.0,
        fps: Annotated[int, between(1, 50)] = 25,
        format: Format = Format.mp4,
        hold: Annotated[float, between(0, 300)] = 1.5,
        pace: Pace = Pace.quickening,
        growing: bool | None = None,
    ) -> None:
        self.frames = max(1, round(seconds * fps))
        self.seconds = seconds
        self.fps = fps
        self.format = format
        self.hold = hold
        self.pace = pace
        self.growing = growing

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        job = fitted(job, largest_side(self.format))
        growing = job.renderer.warm_up is None if self.growing is None else self.growing
        shares = schedule(len(job.strokes), self.frames, self.seconds, self.pace, growing=growing)
        pictures = with_progress(states(job, shares), self.frames, "pictures")
        with filming(folder / "process", self.format, job.size, Fraction(self.fps)) as film:
            for k, picture in enumerate(pictures, start=1):
                film.show(to_bytes(picture), 1 + (round(self.hold * self.fps) if k == self.frames else 0))
        return film.paths


def schedule(n: int, frames: int, seconds: float, pace: Pace, *, growing: bool) -> Iterator[np.ndarray]:
    """How much of each of ``n`` strokes, the bottom one first, there is in each frame: (n,) in [0, 1].

    The first frame has none and the last one all of them.
    """
    growth = min(GROWTH, 0.5 * seconds)
    share = np.arange(n) / max(n, 1)
    begin = (seconds - growth) * (share if pace is Pace.even else np.sqrt(share))
    for now in np.linspace(0, seconds, frames) if frames > 1 else [seconds]:
        drawn = np.clip((now - begin) / growth, 0, 1)
        yield drawn if growing else np.floor(drawn)


def fitted(job: ExportJob, side: int) -> ExportJob:
    """The same painting with at most ``side`` pixels on its longer side."""
    zoom = side / max(job.size)
    if zoom >= 1:
        return job
    size = (max(1, round(job.size[0] * zoom)), max(1, round(job.size[1] * zoom)))
    log.info("the film is drawn with %d x %d pixels, the most that it can have", size[1], size[0])
    return replace(job, strokes=job.strokes.moved(zoom=zoom), size=size)


@torch.no_grad()
def states(job: ExportJob, shares: Iterable[np.ndarray]) -> Iterator[Tensor]:
    """The canvas (3, H, W), to be looked at before the next one is asked for, with so much of each stroke on it.

    Finished strokes are laid over what is there, so that each is drawn once. A blend that leaves out what lies deep
    does not work like that; with it every state is drawn from the beginning.

    Args:
        job: the finished painting.
        shares: (N,) of the strokes from the bottom up, falling from 1 to 0; none of them falls from state to state.
    """
    bare = job.background[:, None, None].expand(3, *job.size)
    canvas, order, done = bare.clone(), job.bottom_up, 0
    adding = layered(job)
    if not adding:
        log.warning("with this blend every picture is drawn from the beginning, which takes long; try blend=tiled")
    for share in shares:
        finished, begun = (int(some.sum()) for some in (share >= 1, share > 0))
        if adding:
            lay(canvas, order[done:finished], job)
            done = finished
        shown = canvas
        if begun > done:
            shown = canvas.clone()
            lay(shown, order[done:begun], job, torch.from_numpy(share[done:begun]))
        yield shown


def lay(canvas: Tensor, number: Tensor, job: ExportJob, share: Tensor | None = None) -> None:
    """Lay strokes ``number`` (n,) of a painting, the bottom one first, over a canvas (3, H, W), in place.

    On black a blend shows what the strokes contribute, on white also what they let through: white light.

    Args:
        canvas: what is there.
        number: which strokes.
        job: the painting.
        share: (n,) how much of each is drawn, in (0, 1]; None for all.
    """
    if not len(number):
        return
    strokes, black, white = job.strokes[number], canvas.new_zeros(3), canvas.new_ones(3)
    if share is not None:
        strokes = unfinished(strokes, share.to(strokes.start))
    for top, rows, part in cuts(strokes, job.size, job.renderer):
        layers = job.renderer(strokes[part].moved(shift=(0, -top)), number[part])
        above, size = torch.arange(len(part), device=part.device).flip(0), (rows, job.size[1])
        painted = job.blend(layers, above, size, black).image
        light = (job.blend(layers, above, size, white).image - painted).mean(0)
        canvas[:, top : top + rows].mul_(light).add_(painted)


def unfinished(strokes: Strokes, share: Tensor) -> Strokes:
    """Strokes (n) from their start to parameter ``share`` (n,) of their curve (de Casteljau)."""
    done = share[:, None]
    left = 1 - done
    first, second = left * strokes.start + done * strokes.control, left * strokes.control + done * strokes.end
    return replace(strokes, control=first, end=left * first + done * second)


@torch.no_grad()
def layered(job: ExportJob) -> bool:
    """Whether strokes that are laid over others look as if both had been laid at once, with this renderer and blend.

    It is tried on some strokes of the painting, all at one place and thin as glazes.
    """
    n = min(PROBES, len(job.strokes))
    some, like = job.strokes[:n], job.strokes.scale.new_ones(n)
    place = (like * PROBE_SIDE / 2)[:, None].expand(n, 2)
    some = replace(some, position=place, scale=like * PROBE_SIDE, opacity=like * PROBE_OPACITY)
    size = (PROBE_SIDE, PROBE_SIDE)
    probe, number = replace(job, strokes=some, size=size), torch.arange(n, device=like.device)
    at_once, in_turn = (job.background.new_zeros(3, *size) for _ in range(2))
    lay(at_once, number, probe)
    for part in number.chunk(2):
        lay(in_turn, part, probe)
    return bool(((at_once - in_turn).abs() < LEVEL).all())
