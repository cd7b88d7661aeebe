"""Define the record of a finished painting, and convert it to and from editable JSON (docs/formats.md)."""

import json
from base64 import b64decode, b64encode
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from io import BytesIO
from reprlib import repr as short_repr
from typing import Any, Self

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from brushexp.errors import UserError
from brushexp.strokes.catalogue import BRUSH_COUNT, FIELDS, LATER_FIELDS, Strokes, check_strokes
from brushexp.system.reading import check_format_version, check_yaml, json_of, shorten_value, yaml_of

LARGEST_ALPHA = 100_000_000  # pixels
LARGEST_SIDE = 1_000_000  # pixels of a canvas
FORMAT = "brushexp catalogue"
VERSION = 4  # version of the format; increase it if new files would mislead older readers
VERSION_WITHOUT = 2  # version of files without `LATER_FIELDS`
DEPTH_UNIT = "rank, 0 is the bottom stroke"
BRUSH_UNIT = "0 or more; a renderer with several textures chooses by it"
ATTRIBUTES = {"height": int, "width": int, "renderer": str, "renderer_hash": str, "seed": int}
AT_ONCE = 4096  # number of strokes held as text at a time
KINDS = {int: "a whole number", str: "text", list: "a list"}


@dataclass(frozen=True)
class Saved:
    """A finished catalogue and the settings that produced it, as stored in a file."""

    strokes: Strokes  # N strokes, float32
    depth: Tensor  # (N,) int32 ranks, a permutation of 0 to N - 1; 0 is the bottom stroke
    size: tuple[int, int]  # height and width of the canvas, pixels
    background: Tensor  # (3,) RGB of the bare canvas, in [0, 1]
    renderer: str  # name of the renderer plugin
    renderer_hash: str = ""  # hash of its checkpoint; empty without a checkpoint
    seed: int = 0  # seed of the run
    config: str = ""  # settings of the run as YAML; untrusted text from which only plugins may be built
    alpha: Tensor | None = None  # (h, w) uint8 alpha of the painting, stretched over the canvas; None if opaque

    def with_strokes(self, strokes: Strokes, front_to_back: Tensor, background: Tensor) -> Self:
        """Return a copy with new strokes and background; ``front_to_back`` (N,) lists stroke indices, top first."""
        depth = (len(strokes) - 1 - front_to_back.argsort()).int().cpu()
        return replace(self, strokes=strokes.map(Tensor.cpu), depth=depth, background=background.cpu())

    def check(self) -> Self:
        """Return the record if it is valid; otherwise raise a UserError that says what is wrong."""
        check_strokes(self.strokes)
        count, ranks = len(self.strokes), self.depth.detach().cpu().sort().values
        if tuple(self.depth.shape) != (count,) or not torch.equal(ranks, torch.arange(count, dtype=ranks.dtype)):
            raise UserError(f"depth is not an order of the strokes; give each rank from 0 to {count - 1} once")
        if not all(1 <= side <= LARGEST_SIDE for side in self.size):
            raise UserError(
                f"the canvas is {self.size[0]} x {self.size[1]} pixels; each side must lie in [1, {LARGEST_SIDE}]"
            )
        background = self.background
        if tuple(background.shape) != (3,) or not bool(((background >= 0) & (background <= 1)).all()):
            raise UserError(f"background is {shorten_value(background.tolist())}; three numbers in [0, 1] are needed")
        if self.alpha is not None and (self.alpha.ndim != 2 or self.alpha.dtype != torch.uint8):
            raise UserError(f"alpha is {tuple(self.alpha.shape)} {self.alpha.dtype}; (h, w) uint8 is needed")
        if not -(2**63) <= self.seed < 2**64:
            raise UserError(f"seed is {self.seed}; a number of 64 bits is needed")
        try:
            check_yaml(self.config)
        except UserError as error:
            raise UserError(f"config is {error}") from error
        return self


def config_of(saved: Saved) -> dict[str, Any]:
    """Parse the config of a run; return an empty dictionary if it is not plain data."""
    try:
        config: dict[str, Any] = yaml_of(saved.config)
    except UserError:
        return {}
    return config


def json_lines(saved: Saved) -> Iterator[str]:
    """Yield the JSON text of a catalogue in pieces, with the config (YAML) as a list of lines."""
    strokes = saved.strokes.map(lambda value: value.detach().to("cpu", torch.float32))
    attributes = {"height": saved.size[0], "width": saved.size[1], "renderer": saved.renderer}
    attributes |= {"renderer_hash": saved.renderer_hash, "seed": saved.seed}
    names, version = fields_in(strokes)
    units = {name: FIELDS[name].unit for name in names} | {"brush": BRUSH_UNIT, "depth": DEPTH_UNIT}
    head = {"format": FORMAT, "format_version": version, **attributes}
    head["background"] = [float(f"{level:.9g}") for level in saved.background.float().tolist()]
    if saved.alpha is not None:
        head["alpha"] = b64encode(png_of(saved.alpha)).decode()
    yield json.dumps(head | {"units": units, "config": saved.config.split("\n")}, ensure_ascii=False, indent=2)[:-2]
    yield ',\n  "strokes": ['
    exact = "%.9g"  # as short as possible, because nine digits distinguish all float32 values
    sizes = {name: FIELDS[name].size for name in names}
    slots = {name: f"[{', '.join([exact] * size)}]" if size else exact for name, size in sizes.items()}
    line = "{" + ", ".join(f'"{name}": {slot}' for name, slot in slots.items()) + ', "brush": %d, "depth": %d}'
    columns = [getattr(strokes, name).reshape(len(strokes), size or 1) for name, size in sizes.items()]
    separator = "\n    "
    for *parts, ranks in zip(
        *(column.split(AT_ONCE) for column in (*columns, strokes.brush[:, None], saved.depth[:, None])), strict=True
    ):
        rows = torch.cat([part.double() for part in (*parts, ranks)], dim=1).tolist()
        text = ",\n    ".join([line % tuple(row) for row in rows])
        yield separator * bool(rows) + text.replace("-0,", "-0.0,").replace("-0]", "-0.0]")  # not -0, an integer
        separator = ",\n    "
    yield "\n  ]\n}\n" if len(strokes) else "]\n}\n"


def fields_in(strokes: Strokes) -> tuple[list[str], int]:
    """Return the fields to store, and the oldest format version that has every non-zero field of the strokes."""
    needed = [first for name, first in LATER_FIELDS.items() if bool(getattr(strokes, name).any())]
    version = max(needed, default=VERSION_WITHOUT)
    return [name for name in FIELDS if LATER_FIELDS.get(name, 0) <= version], version


def parse(text: str) -> Saved:
    """Parse text in the format of `json_lines`; raise a UserError that says where the text deviates from it."""
    try:
        data = json_of(text)
    except UserError as error:
        raise UserError(f"{error}; correct it there, or export again with to=json") from error
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise UserError(f"JSON, but not a {FORMAT}; give a strokes.json of task=export to=json")
    check_format_version(_value_of_type(data, "format_version", int), VERSION)
    height, width, renderer, renderer_hash, seed = (
        _value_of_type(data, name, kind) for name, kind in ATTRIBUTES.items()
    )
    config = _value_of_type(data, "config", list)
    if not all(isinstance(line, str) for line in config):
        raise UserError(f"config is {short_repr(config)}; a list of the lines of a YAML text is needed")
    background = torch.tensor(_numbers(data, "background", 3), dtype=torch.float64).float()
    strokes, depth = _strokes(_value_of_type(data, "strokes", list))
    alpha = None if "alpha" not in data else alpha_of(_base64(_value_of_type(data, "alpha", str)))
    canvas = (strokes, depth.int(), (height, width), background)
    return Saved(*canvas, renderer, renderer_hash, seed, "\n".join(config), alpha)


def png_of(alpha: Tensor) -> bytes:
    """Encode alpha (h, w) uint8 as a grey PNG."""
    Image.fromarray(alpha.cpu().numpy()).save(file := BytesIO(), "PNG")
    return file.getvalue()


def alpha_of(png: bytes) -> Tensor:
    """Decode a PNG made by `png_of`; raise a UserError for other data and for pictures that are too large."""
    try:
        with Image.open(BytesIO(png), formats=["PNG"]) as picture:
            if picture.mode != "L" or picture.width * picture.height > LARGEST_ALPHA:
                raise UserError(f"alpha is a picture of {picture.size} {picture.mode}; a grey PNG is needed")
            return torch.from_numpy(np.array(picture))
    except UserError:
        raise
    except Exception as error:  # decoders raise a dozen kinds of errors
        raise UserError("alpha is not a readable PNG; correct it, or leave it out") from error


def _base64(text: str) -> bytes:
    try:
        return b64decode(text, validate=True)
    except ValueError as error:
        raise UserError("alpha is not base64; correct it, or leave it out") from error


def _strokes(rows: list[Any]) -> tuple[Strokes, Tensor]:
    for index, row in enumerate(rows):
        if not isinstance(row, dict):
            raise UserError(f"stroke {index} is {short_repr(row)}; {{...}} with its fields is needed")
        if unknown := sorted(row.keys() - {*FIELDS, "brush", "depth"}):
            raise UserError(
                f"stroke {index} has a field {short_repr(unknown[0])}; valid: {', '.join(FIELDS)}, brush, depth"
            )
    values = {}
    zeros = {name: [0] * FIELDS[name].size or 0 for name in LATER_FIELDS}
    for name, field in FIELDS.items():
        column = [_numbers(zeros | row, name, field.size, f"stroke {index}: ") for index, row in enumerate(rows)]
        values[name] = torch.tensor(column, dtype=torch.float64).reshape(field.shape(len(rows))).float()
    brushes = [
        _value_of_type({"brush": index, **row}, "brush", int, f"stroke {index}: ") for index, row in enumerate(rows)
    ]
    within = [min(max(brush, -1), BRUSH_COUNT) for brush in brushes]  # `check_strokes` refuses values out of range
    strokes = Strokes(**values, brush=torch.tensor(within, dtype=torch.int64))
    if not any("depth" in row for row in rows):
        return strokes, torch.arange(len(rows))
    ranks = [_value_of_type(row, "depth", int, f"stroke {index}: ") for index, row in enumerate(rows)]
    rank, times = Counter(ranks).most_common(1)[0]
    if times > 1:
        raise UserError(f"{times} strokes have depth {rank}; give each its own, or leave depth out of all")
    return strokes, torch.tensor(ranks).argsort().argsort()


def _numbers(data: dict[str, Any], name: str, size: int, where: str = "") -> Any:
    """Return a value from ``data`` after checking that it is a list of ``size`` numbers, or one number if size is 0."""
    value = data.get(name)
    numbers = value if size else [value]
    if type(numbers) is not list or len(numbers) != (size or 1) or not {type(x) for x in numbers} <= {int, float}:
        needed = f"a list of {size} numbers" if size else "a number"
        raise UserError(f"{where}{name} is {short_repr(value)}; {needed} is needed")
    return value


def _value_of_type(data: dict[str, Any], name: str, kind: type, where: str = "") -> Any:
    value = data.get(name)
    if type(value) is not kind:  # JSON's true is not a number
        raise UserError(f"{where}{name} is {short_repr(value)}; {KINDS[kind]} is needed")
    return value
