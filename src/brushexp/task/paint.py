"""``task=paint``: optimise a catalogue of strokes until it looks like the picture."""

from __future__ import annotations

import logging
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import lightning as L
import torch
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf
from torch import Tensor

from brushexp.checks import Paint, StyleKeys, check_keys
from brushexp.errors import UserError
from brushexp.features.distance import Distance, open_distance
from brushexp.files import to_bytes, write_json, write_picture
from brushexp.loss.base import Loss
from brushexp.loss.style import Colors, Style
from brushexp.paint.metrics import measure
from brushexp.paint.outputs import summary_line
from brushexp.paint.painter import Painter
from brushexp.paint.parts import Parts, Stage
from brushexp.paint.progress import CHECKPOINT, INTERRUPTED, Checkpoints, EarlyStop, Frames, ProgressBar
from brushexp.paint.timelapse import Timelapse
from brushexp.pictures.color import recolored
from brushexp.pictures.load import background_color, load_picture
from brushexp.process import interruptible, peak_memory
from brushexp.registry import build, build_named, plugin_of, plugins
from brushexp.strokes.brushwork import load_brushwork, with_brushwork
from brushexp.strokes.catalogue import Catalogue, Strokes
from brushexp.strokes.storage import Saved, load_catalogue, save_catalogue

log = logging.getLogger(__name__)
STYLE, BRUSHWORK = "style", "brushwork"  # names of the losses that the keys of ``style`` add
AUTO = "auto"  # warm_start that leaves it to the renderer


def run(cfg: DictConfig, start: float) -> dict[str, object]:
    """Paint one picture, write everything into the run's folder, and return the numbers of metrics.json."""
    folder = Path(HydraConfig.get().runtime.output_dir)
    checkpoint = None
    if cfg.get("resume") is not None:
        checkpoint, cfg = interrupted_run(Path(cfg.resume), cfg)
    check_keys(cfg, Paint)
    check_keys(cfg.style, StyleKeys, "style.")
    device = device_of(cfg.device)
    lpips = lpips_of(cfg)
    L.seed_everything(cfg.seed, verbose=False)
    target = load_picture(cfg.image, cfg.resolution)
    parts = parts_of(cfg)
    if cfg.style.image is not None:
        target = in_colors(target, parts, folder)
    background = background_color(cfg.background, target)
    strokes = first_strokes(cfg, target)
    if cfg.steps_per_stroke is not None:
        parts = paced(parts, cfg.steps_per_stroke, len(strokes))
    catalogue = Catalogue(strokes, parts.optimizer.units)
    painter = Painter(catalogue, parts, target, background, seed=cfg.seed).to(device)
    frames = Frames(Timelapse(cfg.frames, cfg.frame_side))
    write_picture(folder / "target.png", target)
    if painter.steps:
        fit(painter, cfg, folder, checkpoint, frames)
    metrics = finish(painter, cfg, folder, start, lpips)
    frames.timelapse.write(folder)
    log.info(summary_line(folder, metrics))
    if painter.stop == INTERRUPTED:
        log.warning("interrupted at step %d; continue with: python run.py resume=%s", painter.step, folder)
        raise KeyboardInterrupt
    return metrics


def interrupted_run(folder: Path, cfg: DictConfig) -> tuple[Path, DictConfig]:
    """Checkpoint and settings of a run that is to be continued.

    Raises:
        UserError: if there is nothing to continue there, or the command line changes what must stay.
    """
    settings, checkpoint = folder / ".hydra" / "config.yaml", folder / CHECKPOINT
    for path in (settings, checkpoint):
        if not path.is_file():
            raise UserError(f"resume={folder}: there is no {path.name}; give the folder of an interrupted run")
    allowed = ("resume", "output", "device", "threads", "checkpoint_every", "task")
    for override in HydraConfig.get().overrides.task:
        if override.lstrip("+~").partition("=")[0] not in allowed:
            raise UserError(f"resume continues a run with its own settings; drop {override}")
    kept = OmegaConf.load(settings)
    assert isinstance(kept, DictConfig)
    kept.merge_with({key: cfg[key] for key in ("output", "device", "threads", "checkpoint_every")})
    return checkpoint, kept


def device_of(name: str) -> torch.device:
    """The device called ``name``; auto is the first CUDA device, or the CPU where there is none."""
    available = torch.cuda.is_available()
    if name == "auto":
        return torch.device("cuda" if available else "cpu")
    try:
        device = torch.device(name)
    except RuntimeError as error:
        raise UserError(f"device={name} is not a device; use device=auto, cpu, cuda or cuda:1") from error
    if device.type not in ("cpu", "cuda"):
        raise UserError(f"device={name} is not supported; use device=auto, cpu, cuda or cuda:1")
    if device.type == "cuda" and (not available or (device.index or 0) >= torch.cuda.device_count()):
        raise UserError(f"device={name}, but PyTorch finds {torch.cuda.device_count()} CUDA devices; use device=cpu")
    return device


def parts_of(cfg: DictConfig) -> Parts:
    """Build what the config names."""
    return Parts(
        stages=stages_of(cfg),
        blend=build(cfg.blend),
        order=build(cfg.order),
        losses=losses_of(cfg),
        density=build(cfg.density),
        sampler=build(cfg.sampler),
        optimizer=build(cfg.optimizer),
    )


def losses_of(cfg: DictConfig) -> dict[str, Loss]:
    """The chosen losses, and those that ``style.image`` and ``style.brushwork`` add to them."""
    losses: dict[str, Loss] = {name: build(node) for name, node in cfg.loss.items()}
    if cfg.style.image is not None:
        for loss in losses.values():
            loss.weight *= cfg.style.content
    for key, name, part in (("image", STYLE, "loss"), ("brushwork", BRUSHWORK, "strokes")):
        if cfg.style[key] is None:
            continue
        if name in losses:
            raise UserError(f"style.{key}={cfg.style[key]} brings the loss {name} with it; drop {name} from loss=...")
        losses[name] = build(cfg.style[part])
    return losses


def in_colors(target: Tensor, parts: Parts, folder: Path) -> Tensor:
    """The target in the colours of the style picture, or as it is if the style takes its colours; writes style.png."""
    style = parts.losses[STYLE]
    assert isinstance(style, Style)
    picture = style.picture(target)
    write_picture(folder / "style.png", picture)
    return target if style.colors is Colors.content else recolored(target, like=picture)


def stages_of(cfg: DictConfig) -> list[Stage]:
    """The renderers and their steps: the chosen one, and before it the one that ``warm_start`` asks for, if any."""
    name, renderer = plugin_of(cfg.renderer).name, build(cfg.renderer)
    first = renderer.stand_in if cfg.warm_start == AUTO else cfg.warm_start
    if first is None or not cfg.steps:
        return [Stage(name, renderer, cfg.steps)]
    names = [plugin.name for plugin in plugins("renderer")]
    if first not in names:
        raise UserError(f"warm_start={first} is not a renderer; choose {AUTO}, null or one of {', '.join(names)}")
    return [Stage(first, build_named("renderer", first, {}), cfg.steps), Stage(name, renderer, cfg.finish_steps)]


def paced(parts: Parts, steps_per_stroke: float, n: int) -> Parts:
    """The same with as many steps in the first stage as move each of ``n`` strokes so often."""
    first, *others = parts.stages
    steps = round(steps_per_stroke * parts.sampler.steps_per_round(n))
    return replace(parts, stages=[replace(first, steps=steps), *others])


def first_strokes(cfg: DictConfig, target: Tensor) -> Strokes:
    """The strokes to start from: those of ``catalogue``, or those that ``init`` makes, with ``style.brushwork``."""
    _, height, width = target.shape
    if cfg.catalogue is not None:
        return strokes_from(Path(cfg.catalogue), cfg.strokes, (height, width))
    n = cfg.strokes or max(1, round(height * width / cfg.pixels_per_stroke))
    if n > height * width:
        raise UserError(
            f"strokes={n} is more than the {height} x {width} picture has pixels; "
            f"set strokes to {height * width} at most, or enlarge the picture with resolution"
        )
    generator = torch.Generator().manual_seed(cfg.seed)
    strokes: Strokes = build(cfg.init)(target, n, generator)
    if cfg.style.brushwork is not None:
        strokes = with_brushwork(strokes, load_brushwork(Path(cfg.style.brushwork)), (height, width), generator)
    return strokes


def strokes_from(path: Path, n: int | None, size: tuple[int, int]) -> Strokes:
    """Strokes of a saved catalogue, bottom first, on a canvas of ``size``."""
    saved = load_catalogue(path)
    if n not in (None, len(saved.strokes)):
        raise UserError(f"strokes={n}, but {path} has {len(saved.strokes)}; drop strokes or catalogue")
    height, width = saved.size
    zoom = max(size) / max(saved.size)
    if abs(zoom * height - size[0]) > 1 or abs(zoom * width - size[1]) > 1:
        raise UserError(
            f"{path} was painted on {height} x {width} pixels, the picture has {size[0]} x {size[1]}; "
            "the sides must have the same ratio"
        )
    return saved.strokes[saved.depth.argsort()].moved(zoom=zoom)


def fit(painter: Painter, cfg: DictConfig, folder: Path, checkpoint: Path | None, frames: Frames) -> None:
    """Take the gradient steps."""
    stop_early = EarlyStop(cfg.early_stop)
    checkpoints = Checkpoints(folder / CHECKPOINT, cfg.checkpoint_every)

    def watch(step: int) -> None:
        frames.look(painter)
        stop_early.look(painter)

    painter.watch = watch
    painter.rehearse()
    if checkpoint is None:
        frames.look(painter)
    trainer = L.Trainer(
        accelerator="gpu" if painter.device.type == "cuda" else "cpu",
        devices=[painter.device.index or 0] if painter.device.type == "cuda" else 1,
        max_epochs=-1,
        logger=[build(node).open(folder) for node in cfg.logger.values()],
        callbacks=[ProgressBar(), frames, checkpoints],
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


def lpips_of(cfg: DictConfig) -> Distance | None:
    """The official LPIPS, if the user has a file for it."""
    if cfg.get("lpips_weights") is None:
        return None
    return open_distance(cfg.lpips_backbone, cfg.lpips_weights, "lpips_weights")


def style_of(painter: Painter, cfg: DictConfig) -> dict[str, float]:
    """How far the painting is from the style picture, by each kernel of the style loss."""
    if cfg.style.image is None:
        return {}
    style = painter.losses[STYLE]
    assert isinstance(style, Style)
    return {f"style_{name}": value for name, value in style.measured(painter.picture(), painter.target).items()}


def finish(painter: Painter, cfg: DictConfig, folder: Path, start: float, lpips: Distance | None) -> dict[str, object]:
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
    metrics: dict[str, object] = {
        **measure(picture, to_bytes(painter.target), lpips),
        **style_of(painter, cfg),
        "seconds": painter.seconds,
        "seconds_total": time.monotonic() - start,
        "seconds_per_step": painter.seconds / painter.step if painter.step else None,
        "peak_memory_mb": peak_memory(),
        "n_strokes": len(strokes),
        "steps": painter.step,
        "device": str(painter.device),
        "status": painter.stop or "completed",
    }
    write_json(folder / "metrics.json", metrics)
    return metrics
