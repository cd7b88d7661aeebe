"""``task=paint``: optimise a catalogue of strokes until it looks like the picture."""

import logging
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import lightning as L
import torch
from omegaconf import DictConfig, OmegaConf

from brushexp.app.fitting import conclude, fit, interrupted_run, trainer_of
from brushexp.app.tracking import trackers_of
from brushexp.errors import UserError
from brushexp.features.distance import Distance, open_distance
from brushexp.painting.assembly import STYLE, components_of, first_strokes, focus_of, in_colors, paced
from brushexp.painting.goals import goals_of
from brushexp.painting.metrics import measure, picture_psnr
from brushexp.painting.outputs import export_job, renderer_of, summary_line
from brushexp.painting.painter import Painter
from brushexp.painting.timelapse import Timelapse
from brushexp.painting.wet import wetted
from brushexp.pictures.load import background_color, load_picture
from brushexp.plugins.export.png import pixels
from brushexp.plugins.export.svg import Svg
from brushexp.plugins.loss.style import Style
from brushexp.registry import plugin_of
from brushexp.strokes.catalogue import Catalogue, Strokes
from brushexp.strokes.storage import Saved, save_catalogue
from brushexp.system.device import device_of
from brushexp.system.files import to_bytes, write_json, write_picture
from brushexp.system.runtime import peak_memory

log = logging.getLogger(__name__)
ON_THE_WAY = 8  # frames of the timelapse that trackers get


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Paint one picture, write everything into the run's folder, and return the numbers of metrics.json."""
    checkpoint = None
    if cfg.get("resume") is not None:
        checkpoint, cfg = interrupted_run(Path(cfg.resume), cfg)
    device = device_of(cfg.device)
    lpips = None if cfg.lpips_weights is None else open_distance(cfg.lpips_backbone, cfg.lpips_weights, "lpips_weights")
    trackers = trackers_of(cfg, folder)
    L.seed_everything(cfg.seed, verbose=False)
    target = load_picture(cfg.image, cfg.resolution)
    focus = focus_of(cfg, target, folder)
    parts = components_of(cfg)
    if cfg.style.image is not None:
        target = in_colors(target, parts, folder)
    background = background_color(cfg.background, target)
    strokes, budget = first_strokes(cfg, target, parts.density, focus)
    parts = paced(parts, cfg.steps_per_stroke, strokes, (target.shape[1], target.shape[2]))
    catalogue = Catalogue(strokes, parts.optimizer.units)
    painter = Painter(
        catalogue, parts, target, background, seed=cfg.seed, focus=focus, budget=budget, coarse=cfg.coarse
    ).to(device)
    failure = None
    timelapse = Timelapse(cfg.frames, cfg.frame_side, seconds=cfg.timelapse_seconds, kind=cfg.timelapse)
    write_picture(folder / "target.png", target)
    with trackers:
        if painter.schedule.steps or cfg.seconds:
            goals = goals_of(early_stop=cfg.early_stop, psnr=cfg.psnr, seconds=cfg.seconds)
            trainer = trainer_of(cfg, device, folder, [trackers], [timelapse, *goals])
            failure = fit(trainer, painter, checkpoint=checkpoint)
        metrics = finish(painter, cfg, folder, None if checkpoint else start, lpips, timelapse)
        trackers.report(
            metrics,
            pictures={name: folder / f"{name}.png" for name in ("target", "painting")},
            frames=some_of(timelapse),
            files={"catalogue": folder / "catalogue.h5"},
        )
    with ThreadPoolExecutor(1) as beside:  # to encode a film leaves Python to others
        film = beside.submit(timelapse.write, folder)
        if cfg.report:
            report(folder)
    film.result()
    log.info(summary_line(folder, metrics))
    conclude(painter, folder, cfg, failure, painter.schedule.step)
    return metrics


def some_of(timelapse: Timelapse) -> dict[int, bytes]:
    """A few frames, step -> JPEG, without the last, which is the painting."""
    state = timelapse.state_dict()
    frames = dict(zip(state["steps"], state["frames"], strict=True))
    steps = sorted(frames)[:-1]
    apart = max(1, -(-len(steps) // ON_THE_WAY))
    return {step: frames[step].numpy().tobytes() for step in steps[::apart]}


def report(folder: Path) -> None:
    """Write the page of the run; whatever goes wrong with it, the run is not lost."""
    from brushexp.results.page.run import write_run_page  # noqa: PLC0415  (runs without a page start sooner)

    try:
        write_run_page(folder)
    except Exception as error:
        log.error("no report.html of this run: %s", error, exc_info=not isinstance(error, UserError))


def style_of(painter: Painter, cfg: DictConfig) -> dict[str, float]:
    """How far the painting is from the style picture, by each kernel of the style loss."""
    if cfg.style.image is None:
        return {}
    style = painter.losses[STYLE]
    assert isinstance(style, Style)
    return {f"style_{name}": value for name, value in style.measured(painter.drawn(), painter.picture.target).items()}


def saved_of(painter: Painter, cfg: DictConfig, strokes: Strokes, front_to_back: torch.Tensor) -> Saved:
    """The finished strokes as a catalogue."""
    strokes = strokes.map(torch.Tensor.cpu)
    depth = torch.empty(len(strokes), dtype=torch.int32)
    depth[front_to_back.cpu()] = torch.arange(len(strokes) - 1, -1, -1, dtype=torch.int32)
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


def finish(
    painter: Painter, cfg: DictConfig, folder: Path, start: float | None, lpips: Distance | None, timelapse: Timelapse
) -> dict[str, object]:
    """Write the painting, its catalogue and, when both are there, its numbers; under a lamp, all but these show it.

    A run that went on has no one ``start``.
    """
    (folder / "metrics.json").unlink(missing_ok=True)  # those of the painting that is being replaced
    painter.schedule.pause()
    painter.hand_over()
    canvas, schedule = painter.picture, painter.schedule
    strokes, front_to_back = wetted(painter, cfg.wet)
    saved = saved_of(painter, cfg, strokes, front_to_back)
    flat, target = to_bytes(canvas.draw(strokes, front_to_back)), to_bytes(canvas.target)
    job = export_job(saved, renderer_of(saved), painter.components.blend, saved.renderer, source=cfg.image)
    measured = measure(flat, target, lpips, canvas.focus)
    picture = flat
    if job.light.depth:
        picture = pixels(job)
        measured["psnr_lit"] = picture_psnr(picture, target)
        write_picture(folder / "flat.png", flat)
        timelapse.add(torch.from_numpy(picture).permute(2, 0, 1) / 255, schedule.step)
    write_picture(folder / "painting.png", picture)
    save_catalogue(folder / "catalogue.h5", saved)
    Svg().write(job, folder)
    assert isinstance(measured["psnr"], float)
    painter.anytime.add(schedule.seconds, measured["psnr"])
    metrics: dict[str, object] = {
        **measured,
        **style_of(painter, cfg),
        "seconds": schedule.seconds,
        "seconds_total": None if start is None else time.monotonic() - start,
        "seconds_per_step": schedule.seconds / schedule.step if schedule.step else None,
        "peak_memory_mb": peak_memory(),
        "n_strokes": len(saved.strokes),
        "steps": schedule.step,
        "device": str(painter.device),
        "status": painter.stop or "completed",
        "anytime": [[round(seconds, 3), round(psnr, 3)] for seconds, psnr in painter.anytime.pairs],
    }
    write_json(folder / "metrics.json", metrics)
    return metrics
