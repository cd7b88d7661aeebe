"""Configuration keys of ``task=film``."""

import logging
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from omegaconf import DictConfig, OmegaConf

from brushexp.contracts import UserError, above, at_least, between, keep_built, plugin_of
from brushexp.contracts.families import Painter
from brushexp.contracts.pictures import size_at
from brushexp.contracts.tasks import PaintTask, as_typed_word, check_painting, key
from brushexp_films.clips import is_film, is_moving, open_clip

log = logging.getLogger(__name__)
FRAMES = "frames"  # name of the folder of catalogues in a run's folder
# keys that films ignore, and their defaults
IGNORED_KEYS = {"catalogue": None, "style.image": None, "working_resolution": "auto"}
SCENE_START = "scene_start"  # config group that chooses the initialiser of a scene; composed after looks
PAGE_KEYS = {"frames", "frame_side", "timelapse", "timelapse_seconds", "report"}  # keys about the making of a picture


@dataclass
class FilmOptions:
    """Configuration keys under ``film``."""

    every: int = key(1, "interval between painted frames, in frames of the film", at_least(1))
    start: float = key(0, "start time in seconds", at_least(0))
    stop: float | None = key(None, "end time in seconds; null = end of the film", above(0, typical=10))
    steps: int = key(8, "gradient steps per frame, starting from the previous frame's strokes", at_least(0))
    change: float = key(0.04, "minimum difference between frames that counts as a change, 0 to 1", between(0.001, 1))


@dataclass
class FilmTask(PaintTask):
    """Paint a film, carrying the strokes from frame to frame; image=clip.mp4 selects this task."""

    module = "brushexp_films.task"
    painted = f"FOLDER/{FRAMES}/000000.h5"
    results = (*PaintTask.results, "film", "preview")

    presets: ClassVar[dict[str, str]] = {"trainer": "default", "look": "oil", f"{SCENE_START}@_global_": "glance"}
    presets |= {"quality": "normal"}

    image: str = key("clip.mp4", "film file")
    film: FilmOptions = field(default_factory=FilmOptions)

    @staticmethod
    def suits(typed: Mapping[str, Any]) -> bool:
        image, resumed = str(typed.get("image") or ""), typed.get("resume")
        files = [image] if os.path.exists(image) else image.split(",")
        can_move = typed.get("task") != "paint"  # task=paint asks for the first picture
        moves = all(is_film(file) or (can_move and is_moving(os.path.expanduser(file))) for file in files)
        return moves or (resumed is not None and (Path(resumed) / FRAMES).is_dir())

    @staticmethod
    def check(cfg: DictConfig, overrides: Sequence[str]) -> None:
        size = size_at(cfg.resolution, *open_clip(Path(cfg.image)).size)
        if isinstance(keep_built(cfg.painter), Painter):
            name = plugin_of(cfg.painter).name
            raise UserError(f"painter={name} paints single pictures, but {cfg.image} is a film; drop painter")
        for name, default in IGNORED_KEYS.items():
            if (value := OmegaConf.select(cfg, name)) not in (default, None):
                raise UserError(f"{name}={value} is for single pictures, but {cfg.image} is a film; drop {name}")
        for name, node in cfg.change.items():
            if not keep_built(node).only_ends:  # carried strokes skip changes that only act at the end of a painting
                word = as_typed_word(str(name), node)
                raise UserError(f"{word} is for single pictures, but {cfg.image} is a film; drop {word}")
        if cfg.background == "transparent":
            raise UserError("background=transparent is for single pictures, but a film is opaque; drop background")
        if unused := sorted({word.partition("=")[0] for word in overrides} & PAGE_KEYS):
            log.warning("films ignore %s: film.mp4 has its own pictures and times", ", ".join(unused))
        start, stop = cfg.film.start, cfg.film.stop
        if stop is not None and stop <= start:
            raise UserError(f"film.stop={stop:g} is not after film.start={start:g}; give a later second")
        check_painting(cfg, overrides, size)
