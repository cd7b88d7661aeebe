"""A finished painting in memory: its strokes, its pictures and its numbers, and the files that it makes."""

import time
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np
import torch
from omegaconf import DictConfig, OmegaConf

from brushexp.features.distance import Distance
from brushexp.painting.assembly import STYLE
from brushexp.painting.metrics import measure, picture_psnr
from brushexp.painting.painting_module import PaintingModule
from brushexp.painting.timelapse import Timelapse
from brushexp.painting.wet import wetted
from brushexp.plugins.export.base import ExportJob
from brushexp.plugins.export.png import pixels
from brushexp.plugins.export.svg import Svg
from brushexp.plugins.loss.style import Style
from brushexp.registry import plugin_of
from brushexp.shading.light import Light
from brushexp.strokes.catalogue import Strokes
from brushexp.strokes.storage import Saved, save_catalogue
from brushexp.system.files import to_bytes, write_json, write_picture
from brushexp.system.run_files import AT_WORK, METRICS_FILE, UNFINISHED
from brushexp.system.runtime import peak_memory


@dataclass(frozen=True)
class Finished:
    """What a painter leaves when it is done; pictures are (H, W, 3) in 8 bits."""

    saved: Saved
    job: ExportJob  # the same, to be drawn
    picture: np.ndarray  # in its light
    flat: np.ndarray  # its colours alone: the same array if there is no light
    target: np.ndarray
    compare: Callable[[], dict[str, float | str | None]]  # picture and target: see `measure`
    others: dict[str, object]  # numbers of the painting beside these
    timelapse: Timelapse  # the pictures on the way

    @cached_property
    def metrics(self) -> dict[str, object]:
        """What metrics.json holds; computed when one looks, because it takes as long as steps."""
        return self.compare() | self.others

    def write(self, folder: Path, start: float | None = None) -> None:
        """Write pictures, catalogue, SVG and, when these are written, ``metrics.json``.

        ``start`` is `time.monotonic` when the program began; a run that went on has no one start.
        """
        (folder / METRICS_FILE).unlink(missing_ok=True)  # that of the painting that is being replaced
        if self.flat is not self.picture:
            write_picture(folder / "flat.png", self.flat)
        write_picture(folder / "painting.png", self.picture)
        save_catalogue(folder / "catalogue.h5", self.saved)
        Svg().write(self.job, folder)
        self.metrics["peak_memory_mb"] = peak_memory()
        self.metrics["seconds_total"] = None if start is None else time.monotonic() - start
        others_follow = {} if self.metrics["status"] in UNFINISHED else {"status": AT_WORK}
        write_json(folder / METRICS_FILE, self.metrics | others_follow)

    def conclude(self, folder: Path) -> None:
        """Write into ``metrics.json`` how the painting ended: now all other files are written."""
        write_json(folder / METRICS_FILE, self.metrics)


def finish(painter: PaintingModule, cfg: DictConfig, timelapse: Timelapse, lpips: Distance | None = None) -> Finished:
    """What a painter has come to; under a lamp, all but catalogue, colours and metrics show it."""
    painter.schedule.pause()
    painter.hand_over()
    canvas = painter.picture
    strokes, front_to_back = wetted(painter, cfg.wet)
    saved, drawn = saved_of(painter, cfg, strokes, front_to_back), canvas.draw(strokes, front_to_back)
    flat, target = to_bytes(drawn), to_bytes(canvas.target)
    job = job_of(saved, painter, cfg)
    picture, lit = flat, dict[str, object]()
    if job.light.depth:
        picture = pixels(job, drawn)
        vars(job)["pictures"] = flat, picture  # else to export it draws both again
        lit = {"psnr_lit": picture_psnr(picture, target)}
    timelapse.add(torch.from_numpy(picture).permute(2, 0, 1) / 255, painter.schedule.step)
    painter.anytime.add(painter.schedule.seconds, picture_psnr(flat, target))
    others = lit | style_of(painter, cfg) | {"painter": plugin_of(cfg.painter).name, "loss": "+".join(cfg.loss)}
    others |= effort_of(painter, len(strokes))
    compare = partial(measure, flat, target, lpips, canvas.focus)
    return Finished(saved, job, picture, flat, target, compare, others, timelapse)


def job_of(saved: Saved, painter: PaintingModule, cfg: DictConfig) -> ExportJob:
    """The finished painting as exporters take it, on the CPU."""
    made = deepcopy(painter.renderer).cpu(), painter.components.blend
    return ExportJob(
        saved.strokes, saved.depth, saved.size, saved.background, *made,
        saved.renderer, str(cfg.image), saved.seed, saved.config, Light(**cfg.light),
    )  # fmt: skip


def effort_of(painter: PaintingModule, n: int) -> dict[str, object]:
    """The numbers of metrics.json that tell how a painting of ``n`` strokes came to be."""
    schedule = painter.schedule
    return {
        "seconds": schedule.seconds,
        "seconds_total": None,
        "seconds_per_step": schedule.seconds / schedule.step if schedule.step else None,
        "peak_memory_mb": peak_memory(),
        "n_strokes": n,
        "steps": schedule.step,
        "device": str(painter.device),
        "status": painter.stop or "completed",
        "cpu_seconds": schedule.cpu_seconds,
        "anytime": [[round(seconds, 3), round(psnr, 3)] for seconds, psnr in painter.anytime.pairs],
    }


def style_of(painter: PaintingModule, cfg: DictConfig) -> dict[str, float]:
    """How far the painting is from the style picture, by each kernel of the style loss."""
    if cfg.style.image is None or not painter.resumable:  # other painters than by steps have no use for it
        return {}
    style = painter.losses[STYLE]
    assert isinstance(style, Style)
    return {f"style_{name}": value for name, value in style.measured(painter.drawn(), painter.picture.target).items()}


def saved_of(painter: PaintingModule, cfg: DictConfig, strokes: Strokes, front_to_back: torch.Tensor) -> Saved:
    """The finished strokes as a catalogue."""
    strokes = strokes.map(torch.Tensor.cpu)
    depth = (len(strokes) - 1 - front_to_back.argsort()).int().cpu()
    return Saved(
        strokes=strokes,
        depth=depth,
        size=painter.picture.size,
        background=painter.picture.background.cpu(),
        renderer=plugin_of(cfg.renderer).name,
        renderer_hash=painter.renderer.weights_hash,
        seed=cfg.seed,
        config=OmegaConf.to_yaml(cfg, resolve=True),
    )
