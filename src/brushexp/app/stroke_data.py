"""Where a task finds the strokes that it trains on, as its config says."""

import hashlib
import json
import logging
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from brushexp.errors import UserError
from brushexp.plugins.engine.base import Engine
from brushexp.plugins.renderer.base import RENDERERS
from brushexp.registry import build, plugin_of
from brushexp.training.datamodule import SimulatedData, StoredData, StrokeData
from brushexp.training.dataset import Origin, first_difference, origin_of
from brushexp.training.writer import simulate_set

log = logging.getLogger(__name__)


def stroke_data(cfg: DictConfig) -> StrokeData:
    """Strokes from the sets of ``data``; without any, from a set that is simulated first, or on the way."""
    if cfg.data is not None:
        paths = [Path(path) for path in cfg.data]
    else:
        node = engine_node(cfg)
        engine: Engine = build(node)
        origin = origin_of(node, engine)
        if cfg.get("simulate") is None:
            return SimulatedData(engine, origin, batch_size=cfg.batch_size, seed=cfg.seed)
        mark = hashlib.sha256(json.dumps(origin.settings(), sort_keys=True).encode()).hexdigest()[:8]
        path = Path(cfg.sets) / f"{origin.engine}-{origin.window}-{mark}-seed{cfg.seed}-{cfg.simulate}"
        log.info("the strokes of this and later runs: %s", path)
        simulate_set(path, engine, origin, cfg.seed, cfg.simulate, wait=True)  # jobs of a sweep may need the same one
        paths = [path]
    return StoredData(paths, batch_size=cfg.batch_size, seed=cfg.seed, limit=cfg.limit)


def data_recipe(data: StrokeData, cfg: DictConfig) -> dict[str, object]:
    """Where the strokes came from."""
    origin = data.origin
    return {
        "engine": origin.engine,
        "engine_config": origin.engine_config,
        "window": origin.window,
        "strokes": [len(strokes) for strokes in data.sets] or None,
        "seed": [strokes.seed for strokes in data.sets] or cfg.seed,
        "limit": cfg.limit,
    }


def origin_for(cfg: DictConfig) -> Origin:
    """Where the strokes of `stroke_data` come from, before any are simulated; a UserError if the sets are none."""
    if cfg.data is None:
        node = engine_node(cfg)
        return origin_of(node, build(node))
    return StoredData([Path(path) for path in cfg.data], limit=cfg.get("limit")).origin


def engine_node(cfg: DictConfig) -> DictConfig:
    """The engine's part of the config; for a renderer that is measured, with the options of its own training.

    Options that are typed win over those.
    """
    plugin, trained = plugin_of(cfg.engine), None if cfg.get("other_data", True) else trained_on(cfg)
    if trained is None or trained.engine != plugin.name or cfg.engine != OmegaConf.structured(plugin.config):
        return cfg.engine
    try:
        return OmegaConf.unsafe_merge(OmegaConf.structured(plugin.config), trained.engine_config)  # type: ignore[return-value]
    except OmegaConfBaseException:  # of another version
        return cfg.engine


def trained_on(cfg: DictConfig) -> Origin | None:
    """What made the strokes that a renderer was trained on; None if its file does not tell."""
    recipe = _data_of_training(cfg)
    if not isinstance(recipe.get("engine_config"), dict):
        return None
    return Origin(str(recipe.get("engine")), recipe["engine_config"], recipe.get("window", 0))


def seed_of_training(cfg: DictConfig) -> int:
    """The seed of the strokes that a renderer was trained on, for its brushes are random; else the config's."""
    seeds = _data_of_training(cfg).get("seed")
    seed = seeds[0] if isinstance(seeds, list) and seeds else seeds
    return seed if isinstance(seed, int) and seed >= 0 else cfg.seed


def _data_of_training(cfg: DictConfig) -> dict[str, Any]:
    checkpoint = cfg.renderer.get("checkpoint")
    recipe = {} if checkpoint is None else RENDERERS.read_recipe(RENDERERS.path_of(checkpoint)).get("data")
    return recipe if isinstance(recipe, dict) else {}


def check_origin(cfg: DictConfig, found: Origin) -> None:
    """Stop with a UserError if a trained renderer knows another brush than that of the strokes, unless wanted."""
    trained = None if cfg.other_data else trained_on(cfg)
    if trained is not None and (difference := first_difference(trained.settings(), found.settings())):
        name = f"engine={found.engine}" if cfg.data is None else cfg.data[0]
        raise UserError(
            f"{name} was made with {difference[1]}, but the renderer was trained on strokes made with {difference[0]}; "
            "give a set made as that one was, or train a renderer on this one; other_data=true takes it all the same"
        )
