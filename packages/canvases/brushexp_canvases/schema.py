"""Define the keys of ``task=canvas``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omegaconf import MISSING, DictConfig, OmegaConf

from brushexp.contracts import Rule, UserError, at_least, between, keep_built, one_of, plugin_of
from brushexp.contracts.families import Painter
from brushexp.contracts.tasks import PaintTask, as_typed_word, check_painting, key

IGNORED_KEYS = {  # keys that canvases ignore, and their defaults
    "catalogue": None, "resume": None, "seconds": None, "psnr": None, "early_stop": None, "style.image": None,
    "style.brushwork": None, "strokes": None, "working_resolution": "auto",
}  # fmt: skip

WITHOUT = {"paper": "smooth", "palette": "own"}  # families that need the whole picture, and the members that do not
NO_NAMES = ("nan", "none", "no", "false", "true", "yes")  # values that are not meant as folder names


def check_canvas(value: str, option: str) -> None:
    """Raise UserError if a value is clearly not meant as a folder name."""
    if value.lower() in NO_NAMES:
        raise UserError(f"{option}={value} is not a folder; type {option}=big.zarr, or drop it to paint in memory")


CANVAS = Rule(check_canvas)


@dataclass
class CanvasTask(PaintTask):
    """Paint a picture of any size tile by tile on a canvas on disk; canvas=big.zarr chooses this task."""

    module = "brushexp_canvases.task"

    image: str = key(MISSING, "picture file of any size, or an OME-Zarr image")
    canvas: str = key("canvas.zarr", "folder of the canvas (Zarr); an existing canvas is continued", CANVAS)
    tile: int = key(1024, "side of a tile in pixels", between(16, 4096))
    margin: int = key(
        64, "width of the margin painted together with a tile, in pixels; at most half a tile", at_least(8)
    )
    workers: int | None = key(
        None, "number of painting processes or jobs, with one thread each; null = one per core", at_least(1, typical=2)
    )
    cluster: str | None = key(
        None, "cluster to use: slurm, or a Dask scheduler's address, tcp://host:8786; null = workers on this machine"
    )
    pyramid: str = key("dzi", "format of the pyramid written beside the canvas", one_of("dzi", "iiif", "none"))

    @staticmethod
    def suits(typed: Mapping[str, Any]) -> bool:
        return typed.get("canvas") is not None

    @staticmethod
    def check(cfg: DictConfig, overrides: Sequence[str]) -> None:
        if isinstance(keep_built(cfg.painter), Painter):
            name = plugin_of(cfg.painter).name
            raise UserError(f"painter={name} paints pictures in memory; drop painter, or drop canvas")
        for name, default in IGNORED_KEYS.items():
            if (value := OmegaConf.select(cfg, name)) not in (default, None):
                cure = "set pixels_per_stroke=" if name == "strokes" else f"drop {name}, or drop canvas"
                raise UserError(f"{name}={value} is for pictures in memory, but canvas={cfg.canvas} is on disk; {cure}")
        for name, node in cfg.change.items():
            if not keep_built(node).only_ends:
                word = as_typed_word(str(name), node)
                raise UserError(f"{word} is for pictures in memory, but canvas={cfg.canvas} is on disk; drop {word}")
        for family, plain in WITHOUT.items():
            if (name := plugin_of(cfg[family]).name) != plain:
                why = f"{family}={name} needs the whole picture, but canvas={cfg.canvas} is painted tile by tile"
                raise UserError(f"{why}; set {family}={plain}, or another look")
        if 2 * cfg.margin > cfg.tile:
            raise UserError(f"margin={cfg.margin} is more than half of tile={cfg.tile}; set margin={cfg.tile // 2}")
        if cfg.background == "transparent":
            raise UserError("background=transparent is for pictures in memory; drop it, or drop canvas")
        if keep_built(cfg.order).needs_accuracy:
            raise UserError(f"order={plugin_of(cfg.order).name} needs the whole painting; drop order, or drop canvas")
        if not Path(cfg.image).exists():
            raise UserError(f"image={cfg.image} does not exist; give a picture file or an OME-Zarr image")
        side = cfg.tile + 2 * cfg.margin
        check_painting(cfg, overrides, (side, side))
