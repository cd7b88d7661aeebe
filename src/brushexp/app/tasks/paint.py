"""``task=paint``: optimise a catalogue of strokes until it looks like the picture."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import lightning as L
import torch
from hydra.core.hydra_config import HydraConfig
from lightning.pytorch.loggers import Logger
from omegaconf import DictConfig, OmegaConf

from brushexp.app.resuming import CHECKPOINT, interrupted_run
from brushexp.app.tracking import trackers_of
from brushexp.errors import UserError
from brushexp.features.distance import Distance, open_distance
from brushexp.painting.assembly import STYLE, first_strokes, focus_of, in_colors, paced, parts_of
from brushexp.painting.cost import calibrate, in_words, predict
from brushexp.painting.goals import Goals
from brushexp.painting.metrics import measure
from brushexp.painting.outputs import renderer_of, summary_line, work_of
from brushexp.painting.painter import Painter
from brushexp.painting.progress import INTERRUPTED, Checkpoints, Frames, ProgressBar
from brushexp.painting.timelapse import Timelapse
from brushexp.pictures.load import background_color, load_picture
from brushexp.pictures.video import format_of
from brushexp.plugins.export.svg import Svg
from brushexp.plugins.loss.style import Style
from brushexp.registry import plugin_of
from brushexp.results.page.run import write_run_page
from brushexp.strokes.catalogue import Catalogue
from brushexp.strokes.storage import Saved, save_catalogue
from brushexp.system.device import device_of
from brushexp.system.files import to_bytes, write_json, write_picture
from brushexp.system.process import interruptible, peak_memory

log = logging.getLogger(__name__)
ON_THE_WAY = 8  # frames of the timelapse that trackers get
AFTER = 4.0  # seconds that metrics and timelapse take after the last step, roughly


def run(cfg: DictConfig, start: float) -> dict[str, object]:
    """Paint one picture, write everything into the run's folder, and return the numbers of metrics.json."""
    folder = Path(HydraConfig.get().runtime.output_dir)
    checkpoint = None
    if cfg.get("resume") is not None:
        checkpoint, cfg = interrupted_run(Path(cfg.resume), cfg)
    device = device_of(cfg.device)
    lpips = lpips_of(cfg)
    trackers = trackers_of(cfg, folder)
    L.seed_everything(cfg.seed, verbose=False)
    target = load_picture(cfg.image, cfg.resolution)
    focus = focus_of(cfg, target, folder)
    parts = parts_of(cfg)
    if cfg.style.image is not None:
        target = in_colors(target, parts, folder)
    background = background_color(cfg.background, target)
    strokes, budget = first_strokes(cfg, target, parts.density, focus)
    parts = paced(parts, cfg.steps_per_stroke, strokes, (target.shape[1], target.shape[2]))
    catalogue = Catalogue(strokes, parts.optimizer.units)
    painter = Painter(
        catalogue, parts, target, background, seed=cfg.seed, focus=focus, budget=budget, coarse=cfg.coarse
    ).to(device)
    kind = format_of(cfg.timelapse, "timelapse")
    frames = Frames(Timelapse(cfg.frames, cfg.frame_side, seconds=cfg.timelapse_seconds, kind=kind))
    write_picture(folder / "target.png", target)
    predicted = None
    with trackers:
        if painter.steps or cfg.seconds:
            predicted = fit(painter, cfg, folder, checkpoint, frames, trackers.loggers, start)
        metrics = finish(painter, cfg, folder, start, lpips, predicted)
        frames.timelapse.write(folder)
        trackers.report(
            metrics,
            pictures={name: folder / f"{name}.png" for name in ("target", "painting")},
            frames=some_of(frames.timelapse),
            files={"catalogue": folder / "catalogue.h5"},
        )
    if cfg.report:
        report(folder)
    log.info(summary_line(folder, metrics))
    if painter.stop == INTERRUPTED:
        log.warning("interrupted at step %d; continue with: python run.py resume=%s", painter.step, folder)
        raise KeyboardInterrupt
    return metrics


def fit(
    painter: Painter,
    cfg: DictConfig,
    folder: Path,
    checkpoint: Path | None,
    frames: Frames,
    loggers: Sequence[Logger],
    start: float,
) -> float | None:
    """Take the gradient steps; the seconds that were predicted for them, None for none."""
    painter.rehearse()
    costs = calibrate(painter) if cfg.seconds is not None else ()
    predicted = predict(painter) if cfg.seconds is None and checkpoint is None else None
    if predicted is not None:
        most = "at most " * (cfg.psnr is not None or cfg.early_stop is not None)
        everything = time.monotonic() - start + predicted + AFTER
        log.info("%s%s of optimisation, %s in all", most, in_words(predicted), in_words(everything))
    goals = Goals(early_stop=cfg.early_stop, psnr=cfg.psnr, seconds=cfg.seconds, costs=costs)
    checkpoints = Checkpoints(folder / CHECKPOINT, cfg.checkpoint_every)

    def watch(step: int) -> None:
        frames.look(painter)
        goals.look(painter)

    painter.watch = watch
    if checkpoint is None:
        frames.look(painter)
    trainer = L.Trainer(
        accelerator="gpu" if painter.device.type == "cuda" else "cpu",
        devices=[painter.device.index or 0] if painter.device.type == "cuda" else 1,
        max_epochs=-1,
        logger=loggers,
        callbacks=[ProgressBar(), frames, goals, checkpoints],
        log_every_n_steps=1,
        enable_checkpointing=False,
        enable_progress_bar=False,
        enable_model_summary=False,
    )
    with interruptible(
        partial(setattr, painter, "stop", INTERRUPTED),
        "stopping after this step; what is painted so far will be written",
    ):
        trainer.fit(painter, range(1), ckpt_path=None if checkpoint is None else str(checkpoint))
    return predicted


def some_of(timelapse: Timelapse) -> dict[int, bytes]:
    """A few frames, step -> JPEG, without the last, which is the painting."""
    state = timelapse.state_dict()
    frames = dict(zip(state["steps"], state["frames"], strict=True))
    steps = sorted(frames)[:-1]
    apart = max(1, -(-len(steps) // ON_THE_WAY))
    return {step: frames[step].numpy().tobytes() for step in steps[::apart]}


def report(folder: Path) -> None:
    """Write the page of the run; whatever goes wrong with it, the run is not lost."""
    try:
        write_run_page(folder)
    except Exception as error:
        log.error("no report.html of this run: %s", error, exc_info=not isinstance(error, UserError))


def lpips_of(cfg: DictConfig) -> Distance | None:
    """The official LPIPS, if the user has a file for it."""
    if cfg.lpips_weights is None:
        return None
    return open_distance(cfg.lpips_backbone, cfg.lpips_weights, "lpips_weights")


def style_of(painter: Painter, cfg: DictConfig) -> dict[str, float]:
    """How far the painting is from the style picture, by each kernel of the style loss."""
    if cfg.style.image is None:
        return {}
    style = painter.losses[STYLE]
    assert isinstance(style, Style)
    return {f"style_{name}": value for name, value in style.measured(painter.picture(), painter.target).items()}


def finish(
    painter: Painter, cfg: DictConfig, folder: Path, start: float, lpips: Distance | None, predicted: float | None
) -> dict[str, object]:
    """Write the painting, its catalogue and its numbers."""
    painter.end_all_but_last()
    picture = to_bytes(painter.picture())
    write_picture(folder / "painting.png", picture)
    with torch.no_grad():
        strokes = painter.catalogue().map(lambda value: value.detach().cpu())
    depth = torch.empty(len(strokes), dtype=torch.int32)
    depth[painter.front_to_back.cpu()] = torch.arange(len(strokes) - 1, -1, -1, dtype=torch.int32)
    saved = Saved(
        strokes=strokes,
        depth=depth,
        size=painter.size,
        background=painter.background.cpu(),
        renderer=plugin_of(cfg.renderer).name,
        renderer_hash=painter.renderer.weights_hash,
        seed=cfg.seed,
        config=OmegaConf.to_yaml(cfg, resolve=True),
    )
    save_catalogue(folder / "catalogue.h5", saved)
    blend = painter.parts.blend
    Svg().write(work_of(saved, renderer_of(saved), blend, saved.renderer, source=cfg.image), folder)
    measured = measure(picture, to_bytes(painter.target), lpips, painter.focus)
    assert isinstance(measured["psnr"], float)
    painter.anytime.add(painter.seconds, measured["psnr"])
    metrics: dict[str, object] = {
        **measured,
        **style_of(painter, cfg),
        "seconds": painter.seconds,
        "predicted_seconds": predicted,
        "seconds_total": time.monotonic() - start,
        "seconds_per_step": painter.seconds / painter.step if painter.step else None,
        "peak_memory_mb": peak_memory(),
        "n_strokes": len(strokes),
        "steps": painter.step,
        "device": str(painter.device),
        "status": painter.stop or "completed",
        "anytime": [[round(seconds, 3), round(psnr, 3)] for seconds, psnr in painter.anytime.pairs],
    }
    write_json(folder / "metrics.json", metrics)
    return metrics
