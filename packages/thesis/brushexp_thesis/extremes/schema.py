"""Define the config keys of ``task=extremes``."""

from collections.abc import Sequence
from dataclasses import dataclass

from omegaconf import DictConfig

from brushexp.contracts import at_least
from brushexp.contracts.tasks import Task, key


@dataclass
class ExtremesTask(Task):
    """Draw and optimise extreme scenes with every renderer, blend and precision, and rate each result's accuracy."""

    is_research = True
    module = "brushexp_thesis.extremes.task"

    renderers: list[str] | None = key(None, "names of renderers; null = all registered renderers, including plugins")
    blends: list[str] | None = key(None, "names of blends; null = all")
    dtypes: list[str] | None = key(None, "names of precisions; null = float64, float32, bfloat16 and float16")
    scenes: list[str] | None = key(None, "names of scenes, as in the tables; null = all")
    patience: float = key(5, "seconds after which the optimisation of a cell, of up to 1,000 steps, ends", at_least(0))

    @staticmethod
    def check(cfg: DictConfig, overrides: Sequence[str]) -> None:
        from brushexp_thesis.extremes.task import choose_axes  # noqa: PLC0415

        choose_axes(**{axis: cfg[axis] for axis in ("renderers", "blends", "dtypes", "scenes")})
