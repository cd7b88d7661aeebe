"""Check, before a run starts, that the files named in a config exist and that its keys are consistent."""

import logging
import re
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from brushexp.bounds import Rule
from brushexp.config.output_folders import run_beside
from brushexp.errors import UserError
from brushexp.pictures.focus import AUTO, OFF
from brushexp.pictures.folders import picture_suffixes
from brushexp.pictures.load import check_ratio, named_color, sides_of_picture, size_of_picture
from brushexp.plugins.painter.base import Painter
from brushexp.registry import keep_built, plugin_of, plugins
from brushexp.results.exports import check_exports
from brushexp.system.device import device_of
from brushexp.system.runtime import check_memory

log = logging.getLogger(__name__)

STEP_KEYS = {  # keys of task=paint that only gradient steps use
    *("init", "order", "loss", "density", "sampler", "optimizer", "style", "catalogue"),
    *("focus", "focus_strength", "faces"),
    *("steps", "steps_per_stroke", "coarse", "warm_up", "finish_steps", "effort", "early_stop", "checkpoint_every"),
}
INSTEAD = {  # keys of task=paint that override other keys, which then have no effect
    "strokes": ("detail", "pixels_per_stroke", "max_strokes"),
    "seconds": ("steps", "steps_per_stroke", "effort"),
    "steps_per_stroke": ("steps", "effort"),
    "steps": ("effort",),
}
NEEDS = {  # keys of task=paint that other keys need to have an effect
    "focus": ("focus_strength",),
    "style.image": ("style.content", "style.colors"),
    "frames": ("frame_side", "timelapse", "timelapse_seconds"),
    "light.depth": ("light.azimuth", "light.elevation", "light.gloss"),
}
LARGEST_RESOLUTION = 16384  # pixels on the longer side of the target picture
EFFORT = (  # numbers of metrics.json about the cost of a painting
    "seconds",
    "seconds_total",
    "seconds_per_step",
    "cpu_seconds",
    "peak_memory_mb",
    "n_strokes",
    "steps",
)
BYTES_PER_STROKE = 500  # minimum memory of an export per stroke; a million strokes took 850 bytes each
BYTES_PER_WINDOW_PIXEL = 16  # bytes per pixel: RGBA in 32 bits
PAINTING_CURVES = ("psnr", "seconds", "loss/", "lr-")  # prefixes of the names of curves that callbacks may watch


def canvas_of(path: str, option: str) -> tuple[int, tuple[int, int]]:
    """Read the number of strokes in a saved painting, and the height and width of its canvas."""
    from brushexp.strokes.storage import load_catalogue  # noqa: PLC0415

    if path.lower().endswith(tuple(picture_suffixes())):
        cure = f"paint it first, brushexp {path} output=outputs/x, and give {option}=outputs/x"
        raise UserError(f"{option}={path} is a picture without strokes, not a painting; {cure}")
    saved = load_catalogue(Path(path), option)
    return len(saved.strokes), saved.size


def working_side(text: str, option: str) -> int:
    """Parse the longer side of a working picture in pixels; raise a UserError for an invalid value."""
    if not re.fullmatch(r"\d{1,9}", text) or not 1 <= int(text) <= LARGEST_RESOLUTION:
        raise UserError(f"{option}={text} is not {AUTO}, null or 1 to {LARGEST_RESOLUTION}; try {option}={AUTO}")
    return int(text)


CATALOGUE = Rule(canvas_of)
COLOR = Rule(named_color)
DEVICE = Rule(device_of)
WORKING = Rule(working_side, besides=(AUTO,))
FOCUS = Rule(partial(size_of_picture, resolution=1, also=f"{AUTO}, "), besides=(AUTO,))
FACES = Rule(partial(size_of_picture, resolution=1, also=f"{AUTO}, {OFF}, "), besides=(AUTO, OFF))


def check_paint(cfg: DictConfig, overrides: Sequence[str]) -> None:
    """Check the config for painting a single picture, and warn of user-set keys that its changes override."""
    from brushexp.painting.changes import build_changes  # noqa: PLC0415
    from brushexp.painting.working_size import sizes_of  # noqa: PLC0415

    check_objective(cfg)
    settings, changes = cfg, build_changes(cfg, keep_built)
    for name, change in changes.items():
        before, settings = settings, change.settings(settings)
        is_same = settings is before
        own = set() if is_same else {str(key) for key in settings if not keeps(before.get(key), settings[key])}
        if unused := sorted(own & {top_of(word) for word in overrides}):
            log.warning("change=%s sets %s itself, so the typed value has no effect", name, " and ".join(unused))
        overrides = [word for word in overrides if top_of(word) not in own]
    sizes = sizes_of(settings)
    for change in changes.values():
        change.check(settings, sizes.working)
    check_painting(settings, overrides, sizes.working, painted=sizes.painting)


def keeps(before: Any, after: Any) -> bool:
    """Check whether a change kept a value; members or options that it adds to a node do not count as overrides.

    >>> keeps({"psnr": 1}, {"psnr": 1, "bits": 2}), keeps({"psnr": 1}, {"psnr": 2})
    (True, False)
    """
    if before == after:
        return True
    are_nodes = isinstance(before, Mapping | DictConfig) and isinstance(after, Mapping | DictConfig)
    return are_nodes and all(value is None or keeps(value, after.get(key)) for key, value in before.items())


def top_of(word: str) -> str:
    """Return the first part of the key in a command-line argument."""
    return word.lstrip("+~").partition("=")[0].partition(".")[0]


def check_objective(cfg: DictConfig) -> None:
    """Raise a UserError if ``objective`` is not a number in the painting's metrics.json."""
    metrics = [keep_built(node).label or name for name, node in cfg.metric.items()]
    lit = ["psnr_lit"] if cfg.light.depth else []
    names = [*dict.fromkeys(["psnr", *metrics, *lit, *EFFORT])]
    is_style = cfg.style.image is not None and str(cfg.objective).startswith("style_")
    if cfg.objective in (None, *names) or is_style:
        return
    others = [plugin.name for plugin in plugins("metric") if plugin.name == cfg.objective]
    cure = f"add metric=[{','.join([*cfg.metric, *others])}]" if others else f"choose one of {', '.join(names)}"
    raise UserError(f"objective={cfg.objective} is not a metric of this painting; {cure}")


def check_painting(
    cfg: DictConfig, overrides: Sequence[str], size: tuple[int, int], *, painted: tuple[int, int] | None = None
) -> None:
    """Raise a UserError for losses, strokes, a mask or a catalogue that do not fit the picture or the memory.

    ``size`` (H, W) is the resolution at which strokes are optimised, and ``painted`` is the size of the painting if the
    painting is larger.
    """
    from brushexp.painting.components import build_stages, check_losses, check_size, stroke_budget  # noqa: PLC0415
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
    for name in ("focus", "faces"):
        if cfg[name] not in (None, AUTO, OFF):
            check_ratio(cfg[name], sides_of_picture(cfg[name], name), painted or size, name)
    if cfg.catalogue is not None:
        in_catalogue, canvas = canvas_of(cfg.catalogue, "catalogue")
        check_ratio(cfg.catalogue, canvas, painted or size, "catalogue")
    strokes = stroke_budget(cfg, painted or size, keep_built(cfg.density), in_catalogue)
    keep_built(cfg.blend).check(strokes, size)
    check_size(cfg, strokes, size)
    if cfg.style.image is not None:
        keep_built(cfg.style.loss).check(size)
    if cfg.timelapse_seconds is not None:
        from brushexp.painting.timelapse import Timelapse  # noqa: PLC0415

        Timelapse(cfg.frames, cfg.frame_side, seconds=cfg.timelapse_seconds)


def warn_of_unused_keys(cfg: DictConfig, overrides: Sequence[str]) -> None:
    """Warn of user-set keys that other keys make ineffective; in a sweep, they may be effective in other jobs."""
    keys = [override.lstrip("+~").partition("=")[0] for override in overrides]
    unused = sorted({key for key in keys if key.partition(".")[0] in STEP_KEYS or key.startswith("change.variety.")})
    if unused and isinstance(keep_built(cfg.painter), Painter):
        log.warning("painter=%s ignores %s", plugin_of(cfg.painter).name, ", ".join(unused))
    elif cfg.catalogue is not None and "order" not in keys and plugin_of(cfg.order).name != "fixed":
        log.warning("the strokes of catalogue=%s get a new order; order=fixed keeps their own", cfg.catalogue)
    if cfg.catalogue is not None and (init := sorted({key for key in keys if key.partition(".")[0] == "init"})):
        log.warning("strokes start from catalogue=%s, so %s has no effect", cfg.catalogue, ", ".join(init))
    for key, others in INSTEAD.items():
        if key in keys and (idle := [other for other in others if other in keys]):
            log.warning("%s overrides %s; type only one of them", key, ", ".join(idle))
    for key, others in NEEDS.items():
        if not OmegaConf.select(cfg, key) and (idle := [other for other in others if other in keys]):
            log.warning("%s has no effect without %s=", ", ".join(idle), key)


def check_export(cfg: DictConfig, overrides: Sequence[str]) -> None:
    """Check that the renderer can be built, and that the painting fits into memory and suits the export formats."""
    from brushexp.compositing.bands import cuts  # noqa: PLC0415
    from brushexp.painting.reopen import export_job  # noqa: PLC0415
    from brushexp.strokes.storage import load_catalogue  # noqa: PLC0415

    saved = load_catalogue(Path(cfg.catalogue))
    renderer = None if cfg.get("renderer") is None else keep_built(cfg.renderer)
    job = export_job(saved, renderer, keep_built(cfg.blend), resolution=cfg.resolution)
    for node in cfg.to.values():
        keep_built(node).check(len(job.strokes), job.size)
    if (run := run_beside(cfg)) and not cfg.overwrite:
        check_exports(run, cfg.to)
    windows = max(len(number) for _, _, number in cuts(job.strokes, job.size, job.renderer))
    pixels = windows * getattr(job.renderer, "window", 0) ** 2
    needed = len(job.strokes) * BYTES_PER_STROKE + pixels * BYTES_PER_WINDOW_PIXEL
    what = f"{len(job.strokes)} strokes on {job.size[1]} x {job.size[0]} pixels"
    check_memory(needed, what, "choose a smaller resolution=, or renderer=analytic")


def check_monitors(cfg: DictConfig, curves: tuple[str, ...]) -> None:
    """Raise a UserError if a callback watches a curve that the task lacks, or needs a curve but does not name one."""
    for name, node in cfg.callbacks.items():
        if not (node.get("monitor") or curves[0]).startswith(curves):
            option = f"callbacks.{name}.monitor"
            raise UserError(f"{option}={node.monitor} is not a curve of task={cfg.task}; try {option}={curves[0]}")
        if node.get("save_top_k", 1) > 1 and node.monitor is None:
            some = f"callbacks.{name}.save_top_k={node.save_top_k}"
            raise UserError(f"{some} needs a curve to watch; try callbacks.{name}.monitor={curves[0]}")
