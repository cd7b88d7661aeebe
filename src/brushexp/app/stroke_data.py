"""Where a task finds the strokes that it trains on, as its config says."""

from __future__ import annotations

import hashlib
import json
import logging
from pathlib import Path

from omegaconf import DictConfig

from brushexp.errors import UserError
from brushexp.plugins.engine.base import Engine
from brushexp.plugins.renderer.weights_file import RENDERERS
from brushexp.registry import build
from brushexp.training.datamodule import EngineSource, StrokeData
from brushexp.training.dataset import Origin, origin_of, require_same_origin
from brushexp.training.writer import StrokeWriter

log = logging.getLogger(__name__)


def stroke_data(cfg: DictConfig) -> StrokeData:
    """Strokes from the sets of ``data``; without any, from a set that is simulated first, or on the way."""
    source: list[Path] | EngineSource
    if cfg.data is not None:
        source = [Path(path) for path in cfg.data]
    else:
        engine: Engine = build(cfg.engine)
        origin = origin_of(cfg.engine, engine)
        if cfg.get("simulate") is None:
            source = EngineSource(engine, origin, seed=cfg.seed)
        else:
            source = [simulated_set(Path(cfg.sets), engine, origin, cfg.seed, cfg.simulate)]
    return StrokeData(source, batch_size=cfg.batch_size, seed=cfg.seed, limit=cfg.limit)


def simulated_set(sets: Path, engine: Engine, origin: Origin, seed: int, n: int) -> Path:
    """The set of ``n`` strokes by ``engine`` in the folder ``sets``, simulated now if it is not there yet."""
    settings = json.dumps(origin.settings(), sort_keys=True)
    mark = hashlib.sha256(settings.encode()).hexdigest()[:8]
    path = sets / f"{origin.engine}-{origin.window}-{mark}-seed{seed}-{n}"
    with StrokeWriter(path, origin, seed, n, wait=True) as writer:  # jobs of a parallel sweep may need the same one
        if writer.done < n:
            log.info("simulating %d strokes for this and later runs: %s", n - writer.done, path)
            writer.simulate(engine)
    return path


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


def check_origin(cfg: DictConfig, found: Origin) -> None:
    """Stop if a trained renderer knows another brush than that of the strokes, unless that is wanted.

    Raises:
        UserError: says what differs, and how to use the strokes all the same.
    """
    checkpoint = cfg.renderer.get("checkpoint")
    recipe = {} if checkpoint is None else RENDERERS.read_recipe(RENDERERS.path_of(checkpoint)).get("data", {})
    if cfg.other_data or not isinstance(recipe, dict) or not {"engine", "engine_config", "window"} <= recipe.keys():
        return
    trained = Origin(recipe["engine"], recipe["engine_config"], recipe["window"])
    name = f"engine={found.engine}" if cfg.data is None else cfg.data[0]
    try:
        require_same_origin(trained, found, name)
    except UserError as error:
        raise UserError(f"{error}; other_data=true takes it all the same") from error
