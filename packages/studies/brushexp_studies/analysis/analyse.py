"""Provide ``brushexp.analyse``, which measures the brushwork of a painting from Python."""

from os import PathLike
from pathlib import Path

from brushexp.contracts.runs import Painting, undisturbed
from brushexp.contracts.strokes import load_catalogue
from brushexp.contracts.tasks import keys_of
from brushexp_studies.analysis.schema import AnalyseTask
from brushexp_studies.analysis.summary import Analysis, analysis_of


def analyse(painting: Painting | str | PathLike[str], *, radius: float | None = None, visible: float = 0) -> Analysis:
    """Measure the brushwork of a painting or a catalogue.h5, as ``task=analyse`` does.

    Args:
        painting: painting returned by `paint`, or the path of a catalogue.
        radius: radius of a stroke's neighbourhood in pixels; None = four pitches, each sqrt(pixels / strokes).
        visible: visible fraction below which a stroke is left out.

    >>> import brushexp
    >>> analysis = brushexp.analyse(brushexp.paint("astronaut", look="plain", resolution=32, strokes=20, steps=1))
    >>> len(analysis.number)
    20
    """
    for name, value in {"radius": radius, "visible": visible}.items():
        keys_of(AnalyseTask)[name].bounds.check(name, value)
    name = "painting" if isinstance(painting, Painting) else str(painting)
    with undisturbed():
        saved = painting.finished.job.saved if isinstance(painting, Painting) else load_catalogue(Path(painting))
        return analysis_of(saved, name, name, radius, visible)
