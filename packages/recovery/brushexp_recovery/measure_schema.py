"""Keys of ``task=measure``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omegaconf import DictConfig

from brushexp.bounds import above, at_least, between
from brushexp.config.keys import key
from brushexp.config.rules import CATALOGUE
from brushexp.config.schema import Task
from brushexp.errors import UserError
from brushexp.pictures.load import PICTURE
from brushexp_recovery.photograph import size_of_photograph

WIDTH = "of the painting from edge to edge of the photograph, centimetres; null = pixels only"
CATALOGUES = (".h5", ".json")
SIZE = "the same as width and height, 92x73"


@dataclass
class MeasureTask(Task):
    """Measure the brushwork of a photograph of a painting: strokes, figures with intervals, a page, tables.

    ``task=analyse`` of a picture is this task, too.
    """

    module = "brushexp_recovery.measure_task"
    alone = "image"

    image: str = key("astronaut", "the photograph, cut to the painting's edges", PICTURE)
    recovered: str | None = key(
        None, "folder of task=recover of it, or its catalogue.h5; null = recover it now", CATALOGUE
    )
    against: str | None = key(None, "a photograph of another painting, to compare with", PICTURE)
    width_cm: float | None = key(None, WIDTH, above(0))
    size_cm: str | None = key(None, SIZE)
    against_width_cm: float | None = key(None, WIDTH, above(0))
    against_size_cm: str | None = key(None, SIZE)
    region: list[str] | None = key(None, "parts to measure: left,top,width,height in pixels, or masks, bright = in")
    views: int = key(6, "the photograph and small changes of it that intervals come from", between(1, 50))
    draws: int = key(40, "of strokes by their confidence, from each view", between(1, 1000))
    threshold: float = key(0.5, "confidence from which on the page shows strokes at first", between(0, 1))
    seed: int = key(0, "seed of views and draws", at_least(0))

    @staticmethod
    def suits(typed: Mapping[str, Any]) -> bool:
        image = str(typed.get("image") or "")
        files = [Path(file) for file in ([image] if Path(image).exists() else image.split(","))]
        return all(file.is_file() and file.suffix.lower() not in CATALOGUES for file in files)

    @staticmethod
    def check(cfg: DictConfig, overrides: Sequence[str]) -> None:
        from brushexp_recovery.measure_scale import scale_of  # noqa: PLC0415

        for prefix, image in (("", cfg.image), ("against_", cfg.against)):
            sizes = cfg[f"{prefix}width_cm"], cfg[f"{prefix}size_cm"]
            if image is not None:
                scale_of(size_of_photograph(image, f"{prefix or 'image'}".rstrip("_")), *sizes, prefix)
            elif any(size is not None for size in sizes):
                name = f"{prefix}{'width_cm' if sizes[0] is not None else 'size_cm'}"
                raise UserError(f"{name} is the size of a second photograph; give against=...")
