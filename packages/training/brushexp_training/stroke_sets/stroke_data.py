"""Provide the strokes for training or evaluation, as a task's config specifies."""

import hashlib
import json
import logging
from pathlib import Path

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from brushexp.contracts import UserError, build, plugin_of
from brushexp.contracts.families import RENDERERS, Engine
from brushexp_training.stroke_sets.datamodule import SimulatedData, StoredData, StrokeData
from brushexp_training.stroke_sets.dataset import Origin, Split, first_difference, origin_of
from brushexp_training.stroke_sets.writer import simulate_set

BATCH_STROKES = 64  # batch size of tasks without the key batch_size
HELD_OUT = 1000  # number of simulated strokes of a split if none is given

log = logging.getLogger(__name__)


def stroke_data(cfg: DictConfig) -> StrokeData:
    """Open the sets in ``data``.

    Without ``data``, a set of ``simulate`` strokes is simulated first; if ``simulate`` is null, strokes are simulated
    on demand.
    """
    batch_size, paths = cfg.get("batch_size", BATCH_STROKES), [Path(path) for path in cfg.data or ()]
    if not paths:
        node = engine_node(cfg)
        engine: Engine = build(node)
        origin = origin_of(node, engine)
        if cfg.get("simulate") is None:
            seed = next(iter(origin_of_training(cfg)[1]), cfg.seed)  # brushes depend on this seed
            return SimulatedData(engine, origin, batch_size=batch_size, seed=seed, held_out=cfg.get("n") or HELD_OUT)
        mark = hashlib.sha256(json.dumps(origin.settings(), sort_keys=True).encode()).hexdigest()[:8]
        path = Path(cfg.sets) / f"{origin.engine}-{origin.window}-{mark}-seed{cfg.seed}-{cfg.simulate}"
        log.info("the strokes of this and later runs: %s", path)
        simulate_set(path, engine, origin, cfg.seed, cfg.simulate, wait=True)  # jobs of a sweep may need the same set
        paths = [path]
    return StoredData(paths, batch_size=batch_size, seed=cfg.seed, limit=cfg.get("limit"))


def measured_count(data: StrokeData, split: Split, n: int | None) -> int:
    """Return the number of strokes to measure in a split, at most ``n``; warn if the split has fewer."""
    count = data.count(split, n)
    if n is not None and count < n:
        log.warning(
            "n=%d: the set has only %d strokes for split=%s, which are measured; give a larger set, or %s",
            *(n, count, split.name.lower(), f"n={count}"),
        )
    return count


def data_recipe(data: StrokeData, cfg: DictConfig) -> dict[str, object]:
    """Return the part of a recipe that describes the origin of the strokes."""
    origin = data.origin
    return {
        "engine": origin.engine,
        "engine_config": origin.engine_config,
        "window": origin.window,
        "strokes": [len(strokes) for strokes in data.sets] or None,
        "seed": [strokes.seed for strokes in data.sets] or data.seed,
        "limit": cfg.limit,
    }


def origin_for(cfg: DictConfig) -> tuple[Origin, list[int]]:
    """Return the origin of the strokes that `stroke_data` would provide, and the seeds of the sets.

    No strokes are simulated.
    """
    if cfg.data is None:
        node = engine_node(cfg)
        return origin_of(node, build(node)), []
    data = StoredData([Path(path) for path in cfg.data], limit=cfg.get("limit"))
    return data.origin, [strokes.seed for strokes in data.sets]


def engine_node(cfg: DictConfig) -> DictConfig:
    """Return the config node of the engine.

    Options that the user did not set default to the values used to simulate the measured renderer's training strokes.
    """
    plugin, (trained, _) = plugin_of(cfg.engine), origin_of_training(cfg)
    if trained is None or trained.engine != plugin.name:
        return cfg.engine
    usual = OmegaConf.structured(plugin.config)
    words = HydraConfig.get().overrides.task if HydraConfig.initialized() else []
    typed = {word.lstrip("+").partition("=")[0] for word in words}
    chosen = {key: value for key, value in cfg.engine.items() if value != usual[key] or f"engine.{key}" in typed}
    try:
        return OmegaConf.unsafe_merge(usual, trained.engine_config, chosen)  # type: ignore[return-value]
    except OmegaConfBaseException:  # the recipe belongs to another version
        return cfg.engine


def origin_of_training(cfg: DictConfig) -> tuple[Origin | None, list[int]]:
    """Read the origin and seeds of a renderer's training strokes.

    Returns (None, []) if they are unknown, or if ``other_data`` allows strokes of other origins.
    """
    checkpoint = cfg.renderer.get("checkpoint")
    if checkpoint is None or cfg.get("other_data", True):
        return None, []
    recipe = RENDERERS.read_recipe(RENDERERS.path_of(checkpoint)).get("data")
    if not isinstance(recipe, dict) or not isinstance(recipe.get("engine_config"), dict):
        return None, []
    seeds = recipe.get("seed")
    valid = [seed for seed in (seeds if isinstance(seeds, list) else [seeds]) if isinstance(seed, int) and seed >= 0]
    return Origin(str(recipe.get("engine")), recipe["engine_config"], recipe.get("window", 0)), valid


def check_origin(cfg: DictConfig) -> Origin:
    """Return the origin of the strokes; raise UserError if the renderer was trained on strokes of another origin.

    Brushes depend on the seeds of the sets, so these must also agree. ``other_data`` allows other origins.
    """
    (origin, seeds), (trained, trained_seeds) = origin_for(cfg), origin_of_training(cfg)
    if trained is not None and (difference := first_difference(trained.settings(), origin.settings())):
        name = f"engine={origin.engine}" if cfg.data is None else cfg.data[0]
        raise UserError(
            f"{name} was made with {difference[1]}, but the renderer was trained on strokes made with {difference[0]}; "
            "give a set made in the same way, or train a renderer on this one; other_data=true accepts it anyway"
        )
    has_brushes = trained is not None and "brushes" in trained.engine_config and trained_seeds
    if has_brushes and (others := [k for k, seed in enumerate(seeds) if seed not in trained_seeds]):
        raise UserError(
            f"{cfg.data[others[0]]} has brushes of seed {seeds[others[0]]}, but the renderer was trained "
            f"on brushes of seed {', '.join(map(str, trained_seeds))}; give a set of that seed, or set other_data=true"
        )
    return origin
