"""Define the config keys of ``task=compare``."""

from dataclasses import dataclass

from omegaconf import MISSING

from brushexp.contracts import FOLDER
from brushexp.contracts.tasks import Task, key


@dataclass
class CompareTask(Task):
    """Compare finished runs by quality over time, and show which run led at each moment."""

    module = "brushexp_studies.task"
    alone = "runs"
    runs: list[str] = key(
        MISSING, "folder of a run or sweep, or a folder of several; separate folders with commas", FOLDER
    )
    cost: str | None = key(None, "metric on the axis of the fronts, such as n_strokes or bits; null = CPU seconds")
    fronts: list[str] = key([], "metrics with a Pareto front, such as [ssim,perceptual]; [] = PSNR and perceptual")
