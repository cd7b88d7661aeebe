"""A catalogue as JSON, which people read, edit and write with scripts.

The attributes of ``catalogue.h5`` are its keys; ``strokes`` has one stroke a line, numbered from 0 in this order, with
the fields of ``FIELDS`` in their units and to the last bit, and its ``depth``. If no stroke has a ``depth``, the first
one is the bottom one; where strokes were deleted, the others keep their order.
"""

import json
from collections.abc import Iterator, Mapping
from itertools import repeat
from typing import Any

import numpy as np
import torch
from torch import Tensor

from brushexp.errors import UserError
from brushexp.strokes.catalogue import FIELDS, Field, Strokes

FORMAT = "brushexp catalogue"
VERSION = 1  # raise it whenever a file of the new kind would mislead an older reader
DEPTH_UNIT = "rank, 0 is the bottom stroke"
ATTRIBUTES = {"height": int, "width": int, "renderer": str, "renderer_hash": str, "seed": int}
KINDS = {int: "a whole number", str: "text"}
EXACT = "%.9g"  # nine digits tell any two float32 apart
DIGITS = 18  # of whole numbers that fit into 64 bits
SHOWN = 60  # characters of a wrong value, in messages


def json_lines(
    strokes: Strokes, depth: Tensor, background: Tensor, config: str, attributes: Mapping[str, object]
) -> Iterator[str]:
    """The lines of the file.

    Args:
        strokes: N strokes, float32.
        depth: (N,) ranks.
        background: (3,) RGB.
        config: YAML; it is written as a list of its lines.
        attributes: those of ``ATTRIBUTES``.
    """
    yield "{\n"
    for key, value in {"format": FORMAT, "format_version": VERSION, **attributes}.items():
        yield f'  "{key}": {json.dumps(value, ensure_ascii=False)},\n'
    yield f'  "background": [{", ".join(EXACT % value for value in background.tolist())}],\n'
    units = {name: field.unit for name, field in FIELDS.items()} | {"depth": DEPTH_UNIT}
    for key, value in {"units": units, "config": config.split("\n")}.items():
        text = json.dumps(value, ensure_ascii=False, indent=2).replace("\n", "\n  ")
        yield f'  "{key}": {text},\n'
    yield '  "strokes": ['
    columns = [getattr(strokes, name).detach().reshape(len(strokes), field.size or 1) for name, field in FIELDS.items()]
    rows = torch.cat(columns, dim=1).double()
    form = "{" + ", ".join(f'"{name}": {_form(field)}' for name, field in FIELDS.items()) + ', "depth": %d}'
    separator = "\n    "
    for row, rank in zip(rows.tolist(), depth.tolist(), strict=True):
        yield separator + form % (*row, rank)
        separator = ",\n    "
    yield "\n  ]\n}\n" if len(strokes) else "]\n}\n"


def _form(field: Field) -> str:
    return f"[{', '.join(repeat(EXACT, field.size))}]" if field.size else EXACT


def parse(text: str) -> tuple[Strokes, Tensor, Tensor, str, dict[str, Any]]:
    """Read what `json_lines` wrote: strokes, depth as int64, background, config and attributes; types are checked.

    Raises:
        UserError: says what is wrong with the text.
    """
    try:
        data = json.loads(text, object_pairs_hook=_once, parse_int=_whole, parse_constant=_no_number)
    except json.JSONDecodeError as error:
        place = f"line {error.lineno}, column {error.colno}"
        raise UserError(f"not JSON ({place}: {error.msg}); mend it there, or export it again with to=json") from error
    except RecursionError as error:
        raise UserError("JSON with too many brackets inside each other; export it again with to=json") from error
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise UserError(f"JSON, but not a {FORMAT}; give a strokes.json of task=export to=json")
    check_version(_attribute(data, "format_version", int))
    attributes = {name: _attribute(data, name, kind) for name, kind in ATTRIBUTES.items()}
    background = _numbers(_there(data, "background"), Field(3, 0, 1, ""), "background")
    config = _there(data, "config")
    if not isinstance(config, list) or not all(isinstance(line, str) for line in config):
        raise UserError(f"config is {_shown(config)}; a list of the lines of a YAML text is needed")
    strokes = _there(data, "strokes")
    if not isinstance(strokes, list):
        raise UserError(f"strokes is {_shown(strokes)}; a list is needed")
    return (*_strokes(strokes), torch.tensor(background, dtype=torch.float64).float(), "\n".join(config), attributes)


def check_version(version: int) -> None:
    """Refuse a file of a format that is not known.

    Raises:
        UserError: says what reads it.
    """
    if version > VERSION:
        raise UserError(
            f"was written by a newer version of brushexp (format {version}; this one reads {VERSION}); update brushexp"
        )
    if version < 1:
        raise UserError(f"format_version is {version}; {VERSION} is needed")


def _strokes(rows: list[Any]) -> tuple[Strokes, Tensor]:
    known = {*FIELDS, "depth"}
    for index, row in enumerate(rows):
        if not isinstance(row, dict):
            raise UserError(f"stroke {index} is {_shown(row)}; {{...}} with its fields is needed")
        if not row.keys() <= known:
            key = _shown(min(row.keys() - known))
            raise UserError(f"stroke {index} has a field {key}; the fields are {', '.join([*FIELDS, 'depth'])}")
    values = {}
    for name, field in FIELDS.items():
        column = [
            _numbers(_there(row, name, index), field, f"stroke {index}: {name}") for index, row in enumerate(rows)
        ]
        with np.errstate(over="ignore"):  # what float32 cannot hold becomes infinite, and is refused as that
            exact = np.array(column, dtype=np.float64).astype(np.float32)
        values[name] = torch.from_numpy(exact.reshape(field.shape(len(rows))))
    if not any("depth" in row for row in rows):
        return Strokes(**values), torch.arange(len(rows))
    ranks = [_there(row, "depth", index) for index, row in enumerate(rows)]
    owner: dict[int, int] = {}
    for index, rank in enumerate(ranks):
        if type(rank) is not int:
            raise UserError(f"stroke {index}: depth is {_shown(rank)}; a whole number is needed ({DEPTH_UNIT})")
        if owner.setdefault(rank, index) != index:
            raise UserError(f"strokes {owner[rank]} and {index} both have depth {rank}; give each stroke another one")
    return Strokes(**values), torch.tensor(ranks, dtype=torch.int64).argsort().argsort()


def _numbers(value: Any, field: Field, what: str) -> Any:
    """The value, if it is a number, or as many numbers as the field has."""
    numbers = value if field.size else [value]
    if type(numbers) is not list or len(numbers) != (field.size or 1) or not {type(x) for x in numbers} <= {int, float}:
        needed = f"a list of {field.size} numbers" if field.size else "a number"
        raise UserError(f"{what} is {_shown(value)}; {needed} is needed")
    return value


def _attribute(data: dict[str, Any], name: str, kind: type) -> Any:
    value = _there(data, name)
    if type(value) is not kind:  # true is no number
        raise UserError(f"{name} is {_shown(value)}; {KINDS[kind]} is needed")
    return value


def _there(data: dict[str, Any], name: str, index: int | None = None) -> Any:
    if name in data:
        return data[name]
    if name == "depth":
        raise UserError(
            f"stroke {index} has no depth; give one to all, or to none: the first is then the bottom stroke"
        )
    whose = "" if index is None else f"stroke {index} "
    raise UserError(f"{whose}has no {name}; it is damaged or not complete")


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object of JSON, if it has each key once."""
    found = dict(pairs)
    if len(found) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise UserError(f"{_shown(twice)} stands twice in one object; drop one")
    return found


def _whole(digits: str) -> int | float:
    return float(digits) if len(digits) > DIGITS or digits == "-0" else int(digits)


def _no_number(text: str) -> float:
    raise UserError(f"{text} is not a number of JSON; every number must be finite")


def _shown(value: Any) -> str:
    """A value of a file, on one short line."""
    text = ascii(value)
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."
