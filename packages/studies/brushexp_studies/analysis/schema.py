"""Define the config keys of ``task=analyse``."""

from dataclasses import dataclass

from omegaconf import MISSING

from brushexp.contracts import at_least, between
from brushexp.contracts.tasks import CATALOGUE, Task, key


@dataclass
class AnalyseTask(Task):
    """Measure the brushwork of a painting, or compare two paintings; write a table, a summary and figures."""

    module = "brushexp_studies.analysis.task"
    alone = "catalogue"
    catalogue: str = key(MISSING, "folder of a run, or its catalogue.h5", CATALOGUE)
    against: str | None = key(None, "folder or catalogue.h5 of a painting to compare with", CATALOGUE)
    radius: float | None = key(
        None, "radius of a neighbourhood in pixels; null = 4 sqrt(pixels / strokes)", at_least(0, typical=30)
    )
    visible: float = key(0, "fraction of a stroke that must be visible for the stroke to count, 0 to 1", between(0, 1))
