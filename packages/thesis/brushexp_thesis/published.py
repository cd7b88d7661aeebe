"""Figures that others have published, with their sources; a leaderboard shows them beside what was measured."""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from brushexp.errors import UserError
from brushexp.system.reading import in_short, read_text, yaml_of

SHIPPED_FIGURES = Path(__file__).with_suffix(".yaml")
FIGURES = ("psnr", "ssim", "ms_ssim", "l1", "lpips_alexnet", "lpips_squeeze", "lpips_vgg16", "seconds")  # there may be
OF_SETS = {"pictures": str, "size": list, "names": list}
OF_LISTS = {"size": int, "names": str, "figures": object}  # what each of their elements is
OF_ENTRIES: dict[str, type | tuple[type, ...]] = {
    "set": str,
    "painter": str,
    "source": str,
    "primitives": int,
    "what": str,
    "machine": str,
}
OF_ENTRIES |= dict.fromkeys(FIGURES, (int, float))


@dataclass(frozen=True, kw_only=True)
class PublishedFigures:
    """What a painter or codec is said to reach."""

    painter: str
    source: str  # authors, year and table; and where the figures were read if not there
    pictures: str  # of which they are a mean
    size: tuple[int, ...]  # width and height in pixels; empty if they differ, or it was not said
    names: frozenset[str]  # files of the pictures, without endings; empty where they are not public
    primitives: int | None  # how many
    what: str  # they are
    machine: str
    figures: Mapping[str, float]  # by names of FIGURES


def read_published(path: Path = SHIPPED_FIGURES, option: str = "published") -> list[PublishedFigures]:
    """The entries of a YAML file: ``sets`` of pictures by name, and ``figures``, each of which names its ``set``.

    A UserError names the entry and the key that is wrong.
    """
    try:
        found = yaml_of(read_text(path, "give a file of published figures"))
        _check(found, {"sets": dict, "figures": list}, ("sets", "figures"), "the file")
        for name, given in found["sets"].items():
            _check(given, OF_SETS, ("pictures",), f"set {name}")
        return [_entry(number, given, found["sets"]) for number, given in enumerate(found["figures"], 1)]
    except UserError as error:
        raise UserError(f"{option}={path}: {error}") from error


def _entry(number: int, given: dict[str, Any], sets: dict[str, dict[str, Any]]) -> PublishedFigures:
    where = f"entry {number} of figures"
    _check(given, OF_ENTRIES, ("set", "painter", "source"), where)
    if given["set"] not in sets:
        raise UserError(f"{where}: set is {in_short(given['set'])}; choose one of {', '.join(sets)}")
    figures = {key: float(given[key]) for key in FIGURES if key in given}
    if not figures:
        raise UserError(f"{where} has no figure; add one of {', '.join(FIGURES)}")
    pictures = sets[given["set"]]
    return PublishedFigures(
        painter=given["painter"],
        source=given["source"],
        pictures=pictures["pictures"],
        size=tuple(pictures.get("size", ())),
        names=frozenset(pictures.get("names", ())),
        primitives=given.get("primitives"),
        what=given.get("what", "strokes"),
        machine=given.get("machine", ""),
        figures=figures,
    )


def _check(given: Any, kinds: Mapping[str, Any], needed: Collection[str], where: str) -> None:
    """Refuse (UserError) what is no mapping of these keys to values of these kinds."""
    if not isinstance(given, dict):
        raise UserError(f"{where} is {in_short(given)}; give a mapping of {', '.join(kinds)}")
    for key, value in given.items():
        if key not in kinds:
            raise UserError(f"{where} has {key!r}; its keys are {', '.join(kinds)}")
        is_right = isinstance(value, kinds[key]) and not isinstance(value, bool)
        if isinstance(value, float):
            is_right &= math.isfinite(value)
        elif is_right and isinstance(value, list):
            is_right = all(isinstance(one, OF_LISTS[key]) for one in value)
        if not is_right:
            raise UserError(
                f"{where}: {key} is {in_short(value)}, which is of another kind; see results/published.yaml"
            )
    for key in needed:
        if key not in given:
            raise UserError(f"{where} has no {key}; add it")
