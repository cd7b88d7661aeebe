"""Read tubes of paint, and compute the colours of their mixtures."""

import csv
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from io import StringIO
from pathlib import Path

import numpy as np
import torch
from PIL import ImageColor

from brushexp.contracts import UserError, build_named
from brushexp.contracts.files import explaining, read_text
from brushexp.contracts.pictures import BT709, encode_srgb

Array = np.ndarray
OUTER, INNER = 0.03, 0.65  # light reflected on entering and on leaving paint (Saunderson, 1942)
MOST_TUBES = 24  # maximum number of tubes on a table
# Relative power of daylight, CIE D65, at 400, 420, ... 700 nm.
NANOMETRES = np.arange(400, 701, 20)
DAYLIGHT = np.array(
    [82.75, 93.43, 104.86, 117.81, 115.92, 109.35, 104.79, 104.41, 100.0, 95.79, 90.01, 87.70, 83.70, 80.21, 78.28,
     71.61]
)  # fmt: skip
LOBES = {  # lobes of the colour matching functions: height, centre and the widths on both sides in nm
    "x": ((1.056, 599.8, 37.9, 31.0), (0.362, 442.0, 16.0, 26.7), (-0.065, 501.1, 20.4, 26.2)),
    "y": ((0.821, 568.8, 46.9, 40.5), (0.286, 530.9, 16.3, 31.1)),
    "z": ((1.217, 437.0, 11.8, 36.0), (0.681, 459.0, 26.0, 13.8)),
}
KINDS = {  # kinds of paint data in a file: letters of the columns -> the columns
    "color": {"color"},
    "R": {f"R{wave}" for wave in NANOMETRES},
    "KS": {f"{letter}{wave}" for letter in "KS" for wave in NANOMETRES},
}
SETS = {  # sets of tubes by name, each from a file in this folder
    "eight": ("acrylics", ("titanium white", "bone black", "hansa yellow opaque", "cadmium orange", "pyrrole red",
                           "quinacridone magenta", "ultramarine blue", "phthalo green blue shade")),
    "acrylics": ("acrylics", ()),
    "zorn": ("oils", ("titanium white", "ivory black", "yellow ochre", "cadmium red light")),
    "primaries": ("acrylics", ("titanium white", "hansa yellow opaque", "quinacridone magenta",
                               "phthalo blue green shade")),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Tubes:
    """T tubes and their mixing model: ``mix`` maps nonnegative parts (M, T) to sRGB colours (M, 3) in [0, 1]."""

    names: tuple[str, ...]
    mix: Callable[[Array], Array]

    def __len__(self) -> int:
        return len(self.names)


def load_tubes(name: str, option: str = "tubes") -> Tubes:
    """Load a shipped set of tubes or the user's CSV file; raise UserError if the file is invalid.

    The file has a ``tube`` column and, for each tube, its ``color`` (sRGB, ``#c8a040``); or reflectances ``R400``
    to ``R700``; or absorption ``K400`` ... and scattering ``S400`` .... Spectra are in steps of 20 nm. Columns are
    separated by commas, or by semicolons or tabs, which spreadsheets use where the decimal mark is a comma.
    """
    file, chosen = SETS.get(name, (name, ()))
    path = Path(__file__).with_name(f"{file}.csv") if name in SETS else Path(file)
    if not path.is_file():
        raise UserError(
            f"{option}={name} is neither a file nor a set; choose one of {', '.join(sorted(SETS))}, or a CSV file"
        )
    cure = "save it as CSV in UTF-8"
    text = read_text(path, cure)
    between = next((mark for mark in ";\t" if mark in text.partition("\n")[0]), ",")
    with explaining(path, cure):
        table = csv.DictReader(StringIO(text, newline=""), delimiter=between)
        rows = [row for row in table if any(row.values())]
    columns = set(table.fieldnames or ())
    names = [" ".join((row.get("tube") or "").split()) for row in rows]
    if not 1 <= len(rows) <= MOST_TUBES or "" in names:
        raise UserError(f"{option}={name}: give 1 to {MOST_TUBES} tubes, each with a name in the column tube")
    folded = [tube.casefold() for tube in names]
    if twice := [tube for tube in names if folded.count(tube.casefold()) > 1]:
        raise UserError(f"{option}={name} has two tubes named {twice[0]}; rename one of them")
    try:
        kind = next(kind for kind, needed in KINDS.items() if needed <= columns)
    except StopIteration:
        needed = "tube and color, or R400 to R700 in steps of 20, or K400 ... and S400 ..."
        raise UserError(f"{option}={name} cannot be read; give the columns {needed}") from None
    values = [_values_of(row, kind, f"{option}={name}, tube {tube}") for tube, row in zip(names, rows, strict=True)]
    indices = [names.index(tube) for tube in chosen or names]
    return Tubes(tuple(names[index] for index in indices), _mixing_model(kind, np.array([values[k] for k in indices])))


def _values_of(row: dict[str, str], kind: str, where: str) -> Array:
    """Parse the values of a tube: sRGB (3,), reflectances (bands,), or absorption and scattering (2, bands)."""
    if kind == "color":
        try:
            return np.array(ImageColor.getrgb((row["color"] or "").strip())[:3]) / 255
        except ValueError as error:
            raise UserError(f"{where}: {row['color'] or 'nothing'} is not a colour; write it as #c8a040") from error
    columns = [[f"{letter}{wave}" for wave in NANOMETRES] for letter in kind]
    spectra = np.array([[_number(row[column], f"{where}: {column}") for column in band] for band in columns])
    if kind == "R" and not ((spectra > 0) & (spectra <= 1)).all():
        raise UserError(f"{where}: a reflectance must be above 0 and at most 1; correct R400 to R700")
    if kind == "KS" and not ((spectra >= 0).all() and (spectra[1] > 0).all()):
        raise UserError(f"{where}: K is 0 or more, and S above 0; correct K400 to S700")
    return spectra[0] if kind == "R" else spectra


def _number(text: str | None, where: str) -> float:
    """Parse a number with a decimal point or comma."""
    try:
        number = float((text or "").replace(",", "."))
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise UserError(f"{where} is {text or 'empty'}, not a number; correct it")
    return number


def _mixing_model(kind: str, values: Array) -> Callable[[Array], Array]:
    """Return the mixing model of T tubes, given their values (T, ...) of one ``kind``; see `_values_of`."""
    if kind == "color":
        return _by_color(values)
    if kind == "R":
        inside = _inside(values)
        return _by_light((1 - inside) ** 2 / (2 * inside), np.ones_like(inside))
    return _by_light(values[:, 0], values[:, 1])


def _shares(parts: Array) -> Array:
    return parts / parts.sum(1, keepdims=True)


def _by_color(colors: Array) -> Callable[[Array], Array]:
    """Mix sRGB colours (T, 3) as ``color=pigment`` does, by geometric means of their reflectances."""
    space = build_named("color", "pigment", {})
    channels = space.encode(torch.from_numpy(colors)).numpy()

    def mix(parts: Array) -> Array:
        mixed = torch.from_numpy(_shares(parts) @ channels).T[:, :, None]
        return space.decode(mixed)[:, :, 0].T.numpy().clip(0, 1)

    return mix


def _by_light(absorbed: Array, scattered: Array) -> Callable[[Array], Array]:
    """Mix opaque paints by averaging absorption and scattering (T, bands) (Kubelka and Munk, 1931)."""

    def mix(parts: Array) -> Array:
        ratio = (_shares(parts) @ absorbed) / (_shares(parts) @ scattered)
        return srgb_of_reflectance(_outside(1 + ratio - np.sqrt(ratio**2 + 2 * ratio)))

    return mix


def _outside(inside: Array) -> Array:
    """Convert internal reflectance to external reflectance, without surface gloss (Saunderson, 1942)."""
    return (1 - OUTER) * (1 - INNER) * inside / (1 - INNER * inside)


def _inside(outside: Array) -> Array:
    return outside / ((1 - OUTER) * (1 - INNER) + INNER * outside)


def srgb_of_reflectance(reflected: Array) -> Array:
    """Compute the sRGB colours (M, 3) of reflectances (M, bands) in daylight (CIE D65), clipped to the gamut.

    The colour matching functions are the fit of Wyman, Sloan and Shirley (2013) to CIE 1931; the errors of the fit
    cancel for white.
    """
    light = reflected @ _light_of_bands()
    return np.asarray(encode_srgb(light.clip(0, 1)))


@cache
def _light_of_bands() -> Array:
    """Compute the linear sRGB colour (bands, 3) of the light in each band, normalised so that perfect white is 1."""
    matching = np.stack([sum(_lobe(*lobe) for lobe in lobes) for lobes in LOBES.values()], axis=1)
    red, green, blue, white = (np.array([x / y, 1, (1 - x - y) / y]) for x, y in BT709)
    columns = np.stack([red, green, blue], axis=1)
    to_xyz = columns * np.linalg.solve(columns, white)  # (3, 3) from linear sRGB
    light = DAYLIGHT[:, None] * matching @ np.linalg.inv(to_xyz).T
    return light / light.sum(0)


def _lobe(height: float, centre: float, below: float, beyond: float) -> Array:
    away = NANOMETRES - centre
    return height * np.exp(-0.5 * (away / np.where(away < 0, below, beyond)) ** 2)
