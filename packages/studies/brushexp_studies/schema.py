"""Keys of ``task=compare``."""

from dataclasses import dataclass

from omegaconf import MISSING

from brushexp.contracts import FOLDER
from brushexp.contracts.tasks import Task, key


@dataclass
class CompareTask(Task):
    """Compare finished runs: which are worth their time, and which was ahead when."""

    module = "brushexp_studies.task"
    alone = "runs"
    runs: list[str] = key(MISSING, "folders of runs or sweeps, or above many of them; several with commas", FOLDER)
    cost: str | None = key(None, "metric on the axis of the fronts, such as n_strokes or bits; null = CPU seconds")
    fronts: list[str] = key([], "metrics that have a front, such as [ssim,perceptual]; [] = PSNR and perceptual")
