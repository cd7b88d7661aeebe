"""Keys of ``task=analyse``."""

from dataclasses import dataclass

from omegaconf import MISSING

from brushexp.bounds import at_least, between
from brushexp.config.keys import key
from brushexp.config.rules import CATALOGUE
from brushexp.config.schema import Task


@dataclass
class AnalyseTask(Task):
    """Measure the brushwork of a saved painting, or of two side by side: table, summary, figures."""

    module = "brushexp_analysis.task"
    catalogue: str = key(MISSING, "catalogue.h5 of a run", CATALOGUE)
    against: str | None = key(None, "catalogue.h5 of another one, to compare with", CATALOGUE)
    radius: float | None = key(None, "pixels to neighbours; null = 4 pitches sqrt(pixels / strokes)", at_least(0))
    visible: float = key(0, "share of a stroke that must be seen, or it is left out", between(0, 1))
