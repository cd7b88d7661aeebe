"""Configuration keys of ``task=brushes``."""

from dataclasses import dataclass

from brushexp.contracts.tasks import Task, key
from brushexp_media.brushes.rule import BRUSH


@dataclass
class BrushesTask(Task):
    """Preview your brush files, and strokes painted with them."""

    module = "brushexp_media.brushes.task"
    alone = "brushes"
    brushes: list[str] = key(
        [], "pictures of strokes, .gbr, .gih, .abr, .brushset, .bundle, folders; none = the dry brush", BRUSH
    )
