"""Read figures published by others, which a leaderboard lists beside its own measurements."""

import math
from dataclasses import dataclass, field
from pathlib import Path

from brushexp.contracts import UserError
from brushexp_thesis.entries import entries_in, entry_of, read_plain_yaml

SHIPPED_FIGURES = Path(__file__).with_suffix(".yaml")
FIGURES = ("psnr", "ssim", "ms_ssim", "l1", "lpips_alexnet", "lpips_squeeze", "lpips_vgg16", "seconds")


@dataclass(kw_only=True)
class PictureSet:
    """A set of pictures over which published figures are averaged."""

    pictures: str  # description in words
    size: list[int] = field(default_factory=list)  # width and height in pixels; empty if sizes differ or are unknown
    names: list[str] = field(default_factory=list)  # file names without suffixes; empty if not public


@dataclass(kw_only=True)
class PublishedFigures:
    """Published figures of one painter or codec, with their source."""

    set: str  # name of the set of pictures
    painter: str
    source: str  # authors, year and table; also the secondary source, if any
    primitives: int | None = None  # number of primitives
    what: str = "strokes"  # kind of primitives
    machine: str = ""
    psnr: float | None = None
    ssim: float | None = None
    ms_ssim: float | None = None
    l1: float | None = None
    lpips_alexnet: float | None = None
    lpips_squeeze: float | None = None
    lpips_vgg16: float | None = None
    seconds: float | None = None
    of: PictureSet = field(default_factory=lambda: PictureSet(pictures=""))  # filled in from the file's sets

    @property
    def figures(self) -> dict[str, float]:
        """The figures that were published, keyed by their names in `FIGURES`."""
        return {name: value for name in FIGURES if (value := getattr(self, name)) is not None}


def read_published(path: Path = SHIPPED_FIGURES) -> list[PublishedFigures]:
    """Read a YAML file that lists named ``sets`` of pictures and ``figures``, each of which refers to one ``set``."""
    try:
        data = read_plain_yaml(path, "give a file of published figures")
        if data.keys() != {"sets", "figures"} or not isinstance(data["sets"], dict):
            raise UserError(f"the file has {', '.join(map(str, data))}; its keys are sets (a mapping) and figures")
        sets = {name: entry_of(PictureSet, entry, f"set {name}") for name, entry in data["sets"].items()}
        for name in (name for one in sets.values() for name in one.names):
            if not isinstance(name, str):
                raise UserError(f"sets has names with {name!r}; give names of files")
        published = entries_in(PublishedFigures, data["figures"], "figures")
        for number, one in enumerate(published, 1):
            if one.set not in sets:
                raise UserError(f"entry {number} of figures: set is {one.set}; choose one of {', '.join(sets)}")
            if not one.figures or not all(map(math.isfinite, one.figures.values())):
                raise UserError(f"entry {number} of figures has no figure, or one is not a number: {one.figures}")
            one.of = sets[one.set]
        return published
    except UserError as error:
        raise UserError(f"published={path}: {error}") from error
