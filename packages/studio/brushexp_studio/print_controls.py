"""Build the controls for the size of a print."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from brushexp_studio.elements import Slide, Tag, chips
from brushexp_studio.prints import OWN, PAPERS, SQUARE
from brushexp_studio.visit import Visit
from brushexp_studio.works import Work

WHOLE, CROPPED = "whole", "cropped"
SMALLEST_SIDE, LARGEST_SIDE = 5, 100  # cm
MOST_MARGIN, MOST_BLEED = 20, 10  # mm


class PrintControls:
    """Controls for paper size, margin and bleed; ``changed`` is called after each change."""

    def __init__(self, visit: Visit, changed: Callable[[], None]) -> None:
        self.visit, self.changed = visit, changed
        self.work: Work | None = None
        self.place = Tag("section", "files prints", aria_label="Print")
        with self.place:
            Tag("h2", text="Print")
            papers = {name: name for name in (*PAPERS, SQUARE, OWN)}
            chips("Paper size", papers, visit.paper.paper, lambda name: self._take(paper=name))
            self.fits = Tag("div")
            with self.fits:
                fits = {WHOLE: "Whole picture", CROPPED: "Fill the paper"}
                chips("Fit", fits, WHOLE, lambda fit: self._take(fill=fit == CROPPED))
            with Tag("div", "slides"):
                self.side = self._slide("side", "Longer side", "cm", SMALLEST_SIDE, LARGEST_SIDE, 1)
                self._slide("margin", "White margin", "mm", 0, MOST_MARGIN, 1)
                self._slide("bleed", "Bleed, to be trimmed", "mm", 0, MOST_BLEED, 0.5)
            self.words = Tag("p", "hint", role="status")
            self.files = Tag("ul", "downloads")

    def show(self, work: Work | None) -> None:
        """Show the controls and the print size of a painting, or hide the controls if there is no painting."""
        self.work = work
        self.place.set_visibility(work is not None)
        self.fits.set_visibility(self.visit.paper.paper in PAPERS)
        self.side.set_visibility(self.visit.paper.paper not in PAPERS)
        if work is not None:
            self.words.set_text(self.visit.paper.words(work.ratio))

    def _slide(self, name: str, title: str, unit: str, low: float, high: float, step: float) -> Slide:
        def take(value: float) -> str:
            if value != getattr(self.visit.paper, name):
                self._take(**{name: value})
            return f"{value:g} {unit}"

        return Slide(take, name=title, low=low, high=high, step=step, value=getattr(self.visit.paper, name))

    def _take(self, **choice: Any) -> None:
        self.visit.paper = replace(self.visit.paper, **choice)
        self.changed()
