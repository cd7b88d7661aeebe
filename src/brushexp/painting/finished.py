"""Hold a finished painting (strokes, pictures and metrics) and write its files."""

import math
import time
from collections.abc import Callable, Collection, Mapping
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from omegaconf import DictConfig, OmegaConf
from torch import Tensor

from brushexp.painting.components import STYLE
from brushexp.painting.metrics import kept_files, measure
from brushexp.painting.schedule import add_pair
from brushexp.painting.working_size import resolution_of
from brushexp.pictures.credits import credits_of, write_credited
from brushexp.pictures.load import TRANSPARENT, load_cutout
from brushexp.pictures.similarity import picture_psnr
from brushexp.plugins.blend.base import Compositor
from brushexp.plugins.export.base import ExportJob
from brushexp.plugins.export.png import Png
from brushexp.plugins.export.svg import Svg
from brushexp.plugins.loss.base import StyleLoss
from brushexp.plugins.metric.base import Metric
from brushexp.plugins.renderer.base import Renderer
from brushexp.registry import plugin_of, take_built
from brushexp.shading.light import Light
from brushexp.strokes.catalogue import Strokes
from brushexp.strokes.storage import Saved, save_catalogue
from brushexp.system.device import device_of
from brushexp.system.files import to_bytes, write_bytes, write_json
from brushexp.system.run_files import METRICS_FILE
from brushexp.system.runtime import peak_memory
from brushexp.system.status import UNFINISHED, Status

if TYPE_CHECKING:  # the page of a painting on disk needs no Lightning
    from brushexp.painting.painting_module import PaintingModule
    from brushexp.painting.timelapse import Timelapse

FASTEST = 1  # compression of a PNG of many megapixels


@dataclass(frozen=True)
class Finished:
    """A finished painting, from memory or from a folder.

    Pictures are (H, W, 3) uint8: ``painting``, ``target`` and, if they exist, ``flat`` (the painting without its lamp),
    ``style`` and ``focus``. They have the size at which the strokes were optimised; the job has the size of the
    painting, which may be larger.
    """

    job: ExportJob
    pictures: Mapping[str, np.ndarray]
    compute_metrics: Callable[[], Mapping[str, Any]]
    timelapse: "Timelapse | None" = None
    whole: np.ndarray | None = None  # the painting at its own size, if it was read from a file
    files: Mapping[str, bytes] = field(default_factory=dict)  # files of the metrics, once they are computed

    @cached_property
    def metrics(self) -> dict[str, Any]:
        """The entries of metrics.json, computed on first use because computing them takes as long as several steps."""
        return dict(self.compute_metrics())

    @cached_property
    def image(self) -> np.ndarray:
        """The painting at its own size, (H, W, 3) uint8."""
        if self.whole is not None:
            return self.whole
        return self.pictures["painting"] if self.is_whole else self.job.picture()

    @property
    def is_whole(self) -> bool:
        """Return whether the pictures are as large as the painting."""
        return self.pictures["painting"].shape[:2] == self.job.size

    def write(self, folder: Path, names: Collection[str] = ("painting", "flat")) -> None:
        """Write the catalogue, the pictures in ``names``, the SVG, the metrics' files, and finally ``metrics.json``."""
        (folder / METRICS_FILE).unlink(missing_ok=True)  # the old metrics describe the painting that is being replaced
        save_catalogue(folder / "catalogue.h5", self.job.saved)  # first, because all other files can be made from it
        about = credits_of(self.job.source)
        for name in (name for name in names if name in self.pictures):
            if name == "painting" and not self.is_whole:
                Png(compression=FASTEST).write(self.job, folder)
                continue
            pixels = self.pictures[name]
            alpha = self.job.at_size(pixels.shape[:2]).alpha()
            shown = pixels if alpha is None else np.dstack([pixels, alpha])
            write_credited(folder / f"{name}.png", shown, about)
        Svg().write(self.job, folder, (self.pictures.get("flat", self.pictures["painting"]), self.pictures["painting"]))
        metrics = self.metrics
        for name, data in self.files.items():
            write_bytes(folder / name, data)
        status = {} if metrics["status"] in UNFINISHED else {"status": Status.AT_WORK}
        write_json(folder / METRICS_FILE, metrics | status)

    def conclude(self, folder: Path) -> None:
        """Write the painting's final status to ``metrics.json``, after all other files have been written."""
        write_json(folder / METRICS_FILE, self.metrics)


def finish(
    painter: "PaintingModule", cfg: DictConfig, timelapse: "Timelapse", metrics: Mapping[str, Metric], *,
    provenance: Mapping[str, Any], start: float | None = None,
) -> Finished:  # fmt: skip
    """Finish a painting; its lamp affects the pictures and ``psnr_lit``, but not the catalogue or other metrics.

    ``provenance`` is added to the metrics. ``start`` is the value of `time.monotonic` at the start of the program, or
    None for a resumed run.
    """
    painter.schedule.pause()
    painter.hand_over()
    canvas = painter.picture
    strokes, front_to_back = painter.finished_strokes()
    colors = canvas.draw(strokes, front_to_back)
    job = bare_job(cfg, deepcopy(painter.renderer).cpu(), canvas.blend, canvas.size)
    saved = job.saved.with_strokes(strokes, front_to_back, canvas.background)
    job = replace(job, saved=replace(saved, alpha=alpha_from(cfg)))
    sources = {name: to_bytes(picture) for name, picture in painter.pictures.items()}
    flat, target, lit = to_bytes(colors), sources["target"], dict[str, object]()
    results = {"painting": flat}
    if not job.is_bare:
        results = {"flat": flat, "painting": job.picture(colors)}
        lit = {"psnr_lit": picture_psnr(results["painting"], target)}
    timelapse.add(torch.from_numpy(results["painting"]).permute(2, 0, 1) / 255, painter.schedule.step)
    add_pair(painter.anytime, painter.schedule.seconds, picture_psnr(flat, target))
    numbers = (
        lit
        | style_distances(painter, cfg, colors)
        | {"painter": plugin_of(cfg.painter).name, "loss": "+".join(cfg.loss)}
    )
    numbers |= painter.components.density.findings()
    numbers |= effort_of(painter, len(strokes)) | {"device": str(device_of(cfg.device))}

    files: dict[str, bytes] = {}

    def compute_metrics() -> dict[str, object]:
        results = measure(metrics, flat, target, focus=canvas.focus, strokes=strokes, job=job.bare()) | numbers
        files.update(kept_files(metrics))
        total = None if start is None else time.monotonic() - start
        return results | {"seconds_total": total, "peak_memory_mb": peak_memory(), "provenance": dict(provenance)}

    whole = job.at_size(painter.painted or canvas.size)
    whole = replace(whole, saved=replace(whole.saved, strokes=painter.enlarge(whole.strokes)))
    return Finished(whole, sources | results, compute_metrics, timelapse, files=files)


def bare_job(cfg: DictConfig, renderer: Renderer, compositor: Compositor, size: tuple[int, int]) -> ExportJob:
    """Create an export job without strokes from the settings and components of a painting."""
    source = plugin_of(cfg.renderer).name, renderer.weights_hash, cfg.seed, OmegaConf.to_yaml(cfg, resolve=True)
    saved = Saved(Strokes.none(), torch.empty(0, dtype=torch.int32), size, torch.ones(3), *source)
    parts = renderer, compositor.blend, compositor.space, Light(**cfg.light)
    return ExportJob(saved, *parts, str(cfg.image), take_built(cfg.paper))


def alpha_from(cfg: DictConfig) -> Tensor | None:
    """Load the picture's alpha (H, W) uint8; return None unless the background and some pixels are transparent."""
    if cfg.background != TRANSPARENT:
        return None
    alpha = (255 * load_cutout(cfg.image, resolution_of(cfg))[1]).round().to(torch.uint8)
    return None if bool((alpha == 255).all()) else alpha


def effort_of(painter: "PaintingModule", n: int) -> dict[str, object]:
    """Collect the cost of a painting of ``n`` strokes (time, steps, memory) for metrics.json."""
    schedule, seconds = painter.schedule, painter.schedule.seconds
    a_step = seconds / schedule.step if schedule.step else None
    effort: dict[str, object] = {
        "seconds": seconds,
        "seconds_total": None,
        "seconds_per_step": a_step,
        "peak_memory_mb": None,
    }
    effort |= {"n_strokes": n, "steps": schedule.step, "status": painter.stop or Status.COMPLETED}
    anytime = [[round(seconds, 3), round(psnr, 3)] for seconds, psnr in painter.anytime]
    return effort | {"cpu_seconds": schedule.cpu_seconds, "anytime": anytime}


def style_distances(painter: "PaintingModule", cfg: DictConfig, colors: Tensor) -> dict[str, float]:
    """Measure the distance between a painting (3, H, W) and the style picture with each kernel of the style loss."""
    if cfg.style.image is None or not painter.resumable:  # only painters that take gradient steps have a style
        return {}
    style = painter.losses[STYLE]
    assert isinstance(style, StyleLoss)
    return {f"style_{name}": value for name, value in style.measure(colors, painter.picture.target).items()}


def summary_line(folder: Path, metrics: Mapping[str, Any]) -> str:
    """Summarise a painting's path, number of strokes, time and quality in one line."""
    psnr, ssim, total = metrics["psnr"], metrics.get("ssim"), metrics["seconds_total"]
    quality = f"{psnr:.2f} dB" if isinstance(psnr, float) and math.isfinite(psnr) else "identical to the target"
    if "psnr_lit" in metrics:
        quality += f" ({metrics['psnr_lit']:.2f} dB in the light)"
    quality += "" if ssim is None else f", SSIM {ssim:.3f}"
    strokes = f"{metrics['n_strokes']} strokes in {metrics['seconds']:.1f} s"
    strokes += "" if total is None else f" ({total:.1f} s in total)"
    return f"{folder / 'painting.png'}: {strokes}, {quality}"
