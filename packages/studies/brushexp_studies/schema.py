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
