"""Check, before anything starts, that the files of a config exist and that its keys fit together."""

import logging
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from omegaconf import DictConfig

from brushexp.bounds import Rule
from brushexp.errors import UserError
from brushexp.pictures.load import check_ratio, named_color, size_of_picture
from brushexp.plugins.painter.base import Painter
from brushexp.registry import keep_built, plugin_of, plugins
from brushexp.system.device import device_of
from brushexp.system.runtime import check_memory

if TYPE_CHECKING:
    from brushexp.training.dataset import Origin

log = logging.getLogger(__name__)

STEP_KEYS = {  # keys of task=paint that only gradient steps use
    *("init", "order", "loss", "density", "sampler", "optimizer", "style", "focus", "focus_strength", "catalogue"),
    *("steps", "steps_per_stroke", "coarse", "warm_up", "finish_steps", "effort", "early_stop", "checkpoint_every"),
}
BYTES_PER_STROKE = 500  # least memory of an export; a million strokes took 850 bytes each
BYTES_PER_WINDOW_PIXEL = 16  # RGBA in 32 bits
BYTES_PER_TRAINED_PIXEL = 48  # of a network's strokes: RGBA of the picture, of what it should be, and of its gradient
AUTO = "auto"  # focus by saliency, and the warm-up renderer that the chosen one names
PAINTING_CURVES = ("psnr", "seconds", "loss/", "lr-")  # how the names of the curves begin that a callback may watch
TRAINING_CURVES = ("validation/psnr_alpha", "validation/", "loss/", "lr-")


def canvas_of(path: str, option: str) -> tuple[int, tuple[int, int]]:
    """Read the number of strokes of a saved painting, and the height and width of its canvas."""
    from brushexp.strokes.storage import load_catalogue  # noqa: PLC0415

    saved = load_catalogue(Path(path), option)
    return len(saved.strokes), saved.size


def _check_set(path: str, option: str) -> None:
    from brushexp.training.dataset import StrokeSet  # noqa: PLC0415

    try:
        StrokeSet(Path(path))
    except UserError as error:
        raise UserError(f"{option}={path}: {error}") from error


CATALOGUE = Rule(canvas_of)
COLOR = Rule(named_color)
DEVICE = Rule(device_of)
FOCUS = Rule(partial(size_of_picture, also=f"{AUTO}, "), besides=(AUTO,))
PAGE = Rule(lambda path, option: Path(path).is_dir() or canvas_of(path, option))
STROKES = Rule(_check_set)


def check_paint(cfg: DictConfig, overrides: Sequence[str]) -> None:
    """Check a painting of one picture."""
    check_painting(cfg, overrides, size_of_picture(cfg.image, "image", cfg.resolution))


def check_painting(cfg: DictConfig, overrides: Sequence[str], size: tuple[int, int]) -> None:
    """Refuse losses, strokes, a mask or a catalogue that do not fit a picture of this size (H, W), or the memory."""
    from brushexp.painting.components import build_stages, check_losses, check_size, stroke_budget  # noqa: PLC0415
    from brushexp.painting.metrics import official_lpips  # noqa: PLC0415
    from brushexp.plugins.renderer.base import check_trained  # noqa: PLC0415

    names = [plugin.name for plugin in plugins("renderer")]
    warn_of_unused_keys(cfg, overrides)
    if cfg.warm_up not in (AUTO, None, *names):
        raise UserError(f"warm_up={cfg.warm_up} is not a renderer; choose auto, null or one of {', '.join(names)}")
    typed = [word.partition("=")[2] for word in overrides if word.startswith("renderer=")]
    *warm_ups, last = build_stages(cfg, keep_built)
    for stage in warm_ups:
        check_trained(stage.renderer, stage.name)
    check_trained(last.renderer, typed[-1] if typed else last.name)
    check_losses(cfg)
    check_monitors(cfg, PAINTING_CURVES)
    in_catalogue = None
    if cfg.focus not in (None, AUTO):
        check_ratio(cfg.focus, size_of_picture(cfg.focus, "focus"), size, "focus")
    if cfg.catalogue is not None:
        in_catalogue, canvas = canvas_of(cfg.catalogue, "catalogue")
        check_ratio(cfg.catalogue, canvas, size, "catalogue")
    strokes = stroke_budget(cfg, size, keep_built(cfg.density), in_catalogue)
    keep_built(cfg.blend).check(strokes, size)
    check_size(cfg, strokes, size)
    if cfg.style.image is not None:
        keep_built(cfg.style.loss).check(size)
    official_lpips(cfg.lpips_backbone, cfg.lpips_weights)
    if cfg.timelapse_seconds is not None:
        from brushexp.painting.timelapse import Timelapse  # noqa: PLC0415

        Timelapse(cfg.frames, cfg.frame_side, seconds=cfg.timelapse_seconds)


def warn_of_unused_keys(cfg: DictConfig, overrides: Sequence[str]) -> None:
    """Log the typed keys that a painter, or a catalogue, has no use for; in a sweep they may be for other jobs."""
    keys = [override.lstrip("+~").partition("=")[0] for override in overrides]
    unused = sorted({key for key in keys if key.partition(".")[0] in STEP_KEYS})
    if unused and isinstance(keep_built(cfg.painter), Painter):
        log.warning("painter=%s has no use for %s", plugin_of(cfg.painter).name, ", ".join(unused))
    init = sorted({key for key in keys if key.partition(".")[0] == "init"})
    if init and cfg.catalogue is not None:
        log.warning("catalogue=%s says where strokes start: it has no use for %s", cfg.catalogue, ", ".join(init))


def check_train(cfg: DictConfig, overrides: Sequence[str]) -> None:
    """Check that training ends, and that the strokes fit the network."""
    from brushexp.plugins.renderer.base import check_trainable  # noqa: PLC0415
    from brushexp.training.stroke_data import origin_for  # noqa: PLC0415

    check_ends(cfg)
    if cfg.data is None and cfg.simulate is None and cfg.limit is not None:
        raise UserError(f"limit={cfg.limit} is for sets, and these strokes are simulated on the way; drop limit")
    origin, seeds = origin_for(cfg)
    window = origin.window
    check_trainable(keep_built(cfg.renderer), window)
    if cfg.critic and window & (window - 1):
        wrong = f"critic=true halves the window until 4 pixels are left, which {window} do not lead to"
        raise UserError(f"{wrong}; give strokes in windows of 64 or 128 pixels (engine.window=64), or drop critic")
    check_brushes(cfg, origin, len(seeds))
    check_batch(cfg, window)


def check_brushes(cfg: DictConfig, origin: "Origin", sets: int) -> None:
    """Stop with a UserError if a renderer of several brushes could not tell apart those of the sets."""
    own, theirs = cfg.renderer.get("brushes") or 1, origin.engine_config.get("brushes") or 1
    if own == 1 or theirs == 1:
        return
    if sets > 1:
        mixed = f"data= names {sets} sets, whose {theirs} brushes each are others under the same numbers"
        raise UserError(f"{mixed}; give one set, and make it larger with n=")
    if own % theirs:
        mixed = f"renderer.brushes={own} is no multiple of engine.brushes={theirs}, so one code would be of several"
        raise UserError(f"{mixed}; set renderer.brushes={theirs}")


def check_batch(cfg: DictConfig, window: int) -> None:
    """Stop with a UserError if memory cannot hold the pictures of a step, ``window`` x ``window`` pixels each."""
    what = f"batch_size={cfg.batch_size} strokes of {window} x {window} pixels"
    check_memory(cfg.batch_size * window**2 * BYTES_PER_TRAINED_PIXEL, what, "choose a smaller batch_size=")


def check_simulate(cfg: DictConfig, overrides: Sequence[str]) -> None:
    """Check that the set can be continued with these strokes, and that memory holds those of one file."""
    from brushexp.training.dataset import origin_of  # noqa: PLC0415
    from brushexp.training.writer import BYTES_PER_PIXEL, SHARD_STROKES, whole_shards  # noqa: PLC0415

    origin = origin_of(cfg.engine, keep_built(cfg.engine))
    strokes = min(cfg.n, SHARD_STROKES)
    what = f"{strokes} strokes of {origin.window} x {origin.window} pixels, those of a file,"
    check_memory(strokes * origin.window**2 * BYTES_PER_PIXEL, what, "choose a smaller engine.window=")
    if cfg.path is not None:
        whole_shards(Path(cfg.path), origin, cfg.seed, cfg.n)


def check_export(cfg: DictConfig, overrides: Sequence[str]) -> None:
    """Check that the renderer can be built, and that the painting fits into memory and its formats."""
    from brushexp.compositing.bands import cuts  # noqa: PLC0415
    from brushexp.plugins.export.job import export_job  # noqa: PLC0415
    from brushexp.strokes.storage import load_catalogue  # noqa: PLC0415

    saved = load_catalogue(Path(cfg.catalogue))
    renderer = None if cfg.get("renderer") is None else keep_built(cfg.renderer)
    job = export_job(saved, renderer, keep_built(cfg.blend), resolution=cfg.resolution)
    for node in cfg.to.values():
        keep_built(node).check(len(job.strokes), job.size)
    windows = max(len(number) for _, _, number in cuts(job.strokes, job.size, job.renderer))
    pixels = windows * getattr(job.renderer, "window", 0) ** 2
    needed = len(job.strokes) * BYTES_PER_STROKE + pixels * BYTES_PER_WINDOW_PIXEL
    what = f"{len(job.strokes)} strokes on {job.size[1]} x {job.size[0]} pixels"
    check_memory(needed, what, "choose a smaller resolution=, or renderer=analytic")


def check_monitors(cfg: DictConfig, curves: tuple[str, ...]) -> None:
    """Stop with a UserError if a callback watches none of the ``curves`` of the task, or has none to choose by."""
    for name, node in cfg.callbacks.items():
        if not (node.get("monitor") or curves[0]).startswith(curves):
            option = f"callbacks.{name}.monitor"
            raise UserError(f"{option}={node.monitor} is no curve of task={cfg.task}; try {option}={curves[0]}")
        if node.get("save_top_k", 1) > 1 and node.monitor is None:
            some = f"callbacks.{name}.save_top_k={node.save_top_k}"
            raise UserError(f"{some} needs a curve to choose by; try callbacks.{name}.monitor={curves[0]}")


def check_ends(cfg: DictConfig) -> None:
    """Stop with a UserError if nothing ends a training."""
    check_monitors(cfg, TRAINING_CURVES)
    limits = (cfg.epochs, cfg.minutes, cfg.trainer.max_time, cfg.callbacks.get("timer"))
    if all(limit is None for limit in limits) and max(cfg.trainer.max_steps, cfg.trainer.max_epochs or -1) < 0:
        raise UserError("neither epochs nor minutes is set, so training would never end; set minutes=60")


def check_evaluate(cfg: DictConfig, overrides: Sequence[str]) -> None:
    """Check that there are strokes, and that the renderer was trained on such strokes."""
    from brushexp.training.stroke_data import check_origin, origin_for  # noqa: PLC0415

    check_origin(cfg, *origin_for(cfg))
