"""Check, before a training run starts, that its strokes, network and limits are consistent."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from omegaconf import DictConfig

from brushexp.contracts import Rule, UserError, keep_built
from brushexp.contracts.machine import check_memory
from brushexp.contracts.tasks import check_monitors

if TYPE_CHECKING:
    from brushexp.contracts.families import Renderer
    from brushexp_training.stroke_sets.dataset import Origin

BYTES_PER_TRAINED_PIXEL = 48  # RGBA of the drawn picture, of the true picture, and of the gradient
TRAINING_CURVES = ("validation/psnr_alpha", "validation/", "loss/", "lr-")


def _check_set(path: str, option: str) -> None:
    from brushexp_training.stroke_sets.dataset import StrokeSet  # noqa: PLC0415

    try:
        StrokeSet(Path(path))
    except UserError as error:
        raise UserError(f"{option}={path}: {error}") from error


STROKES = Rule(_check_set)


def check_train(cfg: DictConfig, overrides: Sequence[str]) -> None:
    """Check that the training has a limit, that the strokes fit the network, and that a batch fits into memory."""
    from brushexp_training.stroke_sets.stroke_data import origin_for  # noqa: PLC0415

    check_ends(cfg)
    if cfg.data is None and cfg.simulate is None and cfg.limit is not None:
        raise UserError(f"limit={cfg.limit} is for stored sets, but these strokes are simulated on demand; drop limit")
    origin, seeds = origin_for(cfg)
    window = origin.window
    check_trainable(keep_built(cfg.renderer), window)
    if cfg.critic and window & (window - 1):
        wrong = f"critic=true halves the window down to 4 pixels, which is impossible for {window}"
        raise UserError(f"{wrong}; give strokes in windows of 64 or 128 pixels (engine.window=64), or drop critic")
    check_brushes(cfg, origin, len(seeds))
    check_batch(cfg, window)


def check_brushes(cfg: DictConfig, origin: "Origin", sets: int) -> None:
    """Raise UserError if a renderer with several brushes could not distinguish the brushes in the sets."""
    own, theirs = cfg.renderer.get("brushes") or 1, origin.engine_config.get("brushes") or 1
    if own == 1 or theirs == 1:
        return
    if sets > 1:
        mixed = f"data= names {sets} sets, which have different brushes under the same {theirs} numbers"
        raise UserError(f"{mixed}; give one set, and make it larger with n=")
    if own % theirs:
        mixed = f"renderer.brushes={own} is not a multiple of engine.brushes={theirs}, so brushes would share codes"
        raise UserError(f"{mixed}; set renderer.brushes={theirs}")


def check_batch(cfg: DictConfig, window: int) -> None:
    """Raise UserError if the pictures of one step, with ``window`` x ``window`` pixels each, do not fit into memory."""
    what = f"batch_size={cfg.batch_size} strokes of {window} x {window} pixels"
    check_memory(cfg.batch_size * window**2 * BYTES_PER_TRAINED_PIXEL, what, "choose a smaller batch_size=")


def check_simulate(cfg: DictConfig, overrides: Sequence[str]) -> None:
    """Check that an existing set can be continued with these settings, and that one file fits into memory."""
    from brushexp_training.stroke_sets.dataset import origin_of  # noqa: PLC0415
    from brushexp_training.stroke_sets.writer import BYTES_PER_PIXEL, SHARD_STROKES, whole_shards  # noqa: PLC0415

    origin = origin_of(cfg.engine, keep_built(cfg.engine))
    strokes = min(cfg.n, SHARD_STROKES)
    what = f"{strokes} strokes of {origin.window} x {origin.window} pixels in one file"
    check_memory(strokes * origin.window**2 * BYTES_PER_PIXEL, what, "choose a smaller engine.window=")
    if cfg.path is not None:
        whole_shards(Path(cfg.path), origin, cfg.seed, cfg.n)


def check_ends(cfg: DictConfig) -> None:
    """Raise UserError if no limit would ever end the training."""
    check_monitors(cfg, TRAINING_CURVES)
    limits = (cfg.epochs, cfg.minutes, cfg.trainer.max_time, cfg.callbacks.get("timer"))
    if all(limit is None for limit in limits) and max(cfg.trainer.max_steps, cfg.trainer.max_epochs or -1) < 0:
        raise UserError("neither epochs nor minutes is set, so training would never end; set minutes=60")


def check_evaluate(cfg: DictConfig, overrides: Sequence[str]) -> None:
    """Check that the strokes exist, and that the renderer was trained on strokes of the same origin."""
    from brushexp_training.stroke_sets.stroke_data import check_origin  # noqa: PLC0415

    check_origin(cfg)


def check_trainable(renderer: "Renderer", window: int) -> None:
    """Raise UserError unless a renderer has trainable weights and draws windows of ``window`` pixels."""
    if not any(parameter.requires_grad for parameter in renderer.parameters()):
        raise UserError("this renderer has no weights to train; try renderer=neural")
    if (own := getattr(renderer, "window", window)) != window:
        difference = f"renderer.window={own}, but the strokes have {window} pixels"
        raise UserError(f"{difference}; set renderer.window={window}")
