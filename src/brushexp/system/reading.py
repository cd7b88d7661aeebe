"""Read files as untrusted data: nothing in them is executed, and all sizes are bounded.

docs/formats.md lists the files and their limits. A one-line UserError says what is wrong with a file; functions that
take a path also name the file.
"""

import csv
import hashlib
import io
import json
import math
import re
import stat
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Iterator
from contextlib import contextmanager
from copy import deepcopy
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml  # type: ignore[import-untyped,unused-ignore]
from omegaconf import OmegaConf

from brushexp.errors import UserError

LONGEST_QUOTE = 160  # largest number of characters of a value in a message
LARGEST_TEXT = 2**24  # bytes of the largest file of numbers or settings
LARGEST_YAML = 2**20  # largest number of characters; the settings of a run have a few thousand
DEEPEST = 32  # largest number of levels of nested lists and mappings
MOST_VALUES = 100_000  # largest number of values in a file of settings
ODD = re.compile(r"\\u[dD][89a-fA-F][0-9a-fA-F]{2}")  # undecodable bytes in names, which the fast loader rejects
EVENTS = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
ROOTS: dict[type, Any] = {
    dict: (yaml.MappingStartEvent, "mapping of keys to values"),
    list: (yaml.SequenceStartEvent, "list"),
}


def shorten_value(value: object) -> str:
    """Shorten a value from a file, or an error that it caused, to one line that fits in a message."""
    text = " ".join(str(value).split())
    return text if len(text) <= LONGEST_QUOTE else text[: LONGEST_QUOTE - 3] + "..."


def check_file(path: Path, cure: str, largest: float = math.inf) -> None:
    """Raise a UserError with ``cure`` unless ``path`` is a readable regular file of at most ``largest`` bytes."""
    try:
        status = path.stat()
        if regular := stat.S_ISREG(status.st_mode):
            path.open("rb").close()
    except FileNotFoundError as error:
        raise UserError(f"there is no file {path}; {cure}") from error
    except (OSError, ValueError) as error:
        raise UserError(f"{path} cannot be read ({getattr(error, 'strerror', error)}); {cure}") from error
    if not regular:
        raise UserError(f"{path} is a folder, a device or a pipe, not a file; {cure}")
    if status.st_size > largest:
        raise UserError(f"{path} has {status.st_size / 1e6:.0f} MB, more than {largest / 1e6:.0f}; {cure}")


@contextmanager
def explaining(path: Path, cure: str) -> Iterator[None]:
    """Turn any error into a UserError that names the file, and add ``cure`` unless the message already has a ``;``."""
    try:
        yield
    except UserError as error:
        raise UserError(f"{path}: {error}" + (f"; {cure}" if cure and ";" not in str(error) else "")) from error
    except Exception as error:  # HDF5, pickle, zip and Pillow raise their own errors
        reason = getattr(error, "strerror", None)  # messages of libraries do not help users
        raise UserError(
            f"{path} is damaged or cut short{f' ({shorten_value(reason)})' * bool(reason)}; {cure}"
        ) from error


def read_text(path: Path, cure: str, largest: int = LARGEST_TEXT) -> str:
    """Check a text file with `check_file`, then read it with `decode_text`."""
    check_file(path, cure, largest)
    with explaining(path, cure):
        return decode_text(path.read_bytes())


def decode_text(data: bytes) -> str:
    r"""Decode UTF-8, or UTF-16 with a byte order mark, removing the mark and changing line ends to ``\n``.

    Windows programs write byte order marks, UTF-16 and ``\r\n``. Other encodings raise a UserError.

    >>> decode_text(b"\xef\xbb\xbfa: 1\r\n"), decode_text("ä".encode("utf-16"))
    ('a: 1\n', 'ä')
    """
    encoding = "utf-16" if data.startswith((BOM_UTF16_LE, BOM_UTF16_BE)) else "utf-8-sig"
    try:
        return data.decode(encoding).replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        raise UserError("not text in UTF-8; save it with that encoding") from error


def read_table(path: Path) -> list[dict[str, str]]:
    """Read the rows of a CSV file; missing cells are None.

    A file without a ``step`` column, or one that cannot be read, has no rows.
    """
    try:
        rows = list(csv.DictReader(io.StringIO(read_text(path, ""), newline=""), restkey=""))
    except (UserError, csv.Error):
        return []
    return [{name: cell for name, cell in row.items() if name} for row in rows if "step" in row]


def digest_of(path: Path) -> str:
    """Compute the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def check_format_version(version: object, known: int) -> None:
    """Raise a UserError if a file's format version is invalid or newer than ``known``.

    >>> check_format_version(3, 2)
    Traceback (most recent call last):
    ...
    brushexp.errors.UserError: has format_version 3, and this brushexp reads 2; update brushexp
    """
    if type(version) is not int or version < 1:  # true is not a number
        raise UserError(f"has an invalid format_version {shorten_value(version)}; get it again")
    if version > known:
        raise UserError(f"has format_version {version}, and this brushexp reads {known}; update brushexp")


def json_of(text: str) -> Any:
    """Parse JSON; reject duplicate keys."""

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        mapping = dict(pairs)
        if len(mapping) < len(pairs):
            raise ValueError(f"a key is repeated in {{{', '.join(key for key, _ in pairs)}}}")
        return mapping

    try:
        return json.loads(text, object_pairs_hook=unique)
    except json.JSONDecodeError as error:
        raise UserError(f"not JSON (line {error.lineno}, column {error.colno}: {error.msg})") from error
    except RecursionError as error:
        raise UserError("JSON with too many nested brackets") from error
    except ValueError as error:
        raise UserError(f"not JSON ({shorten_value(error)})") from error


def check_yaml(text: str, root: type = dict) -> None:
    """Reject YAML that is too long or deep, has aliases, or is not a mapping (or list), without building its values.

    PyYAML takes minutes to parse 40 kB of brackets, and nested aliases exhaust memory.
    """
    if len(text) > LARGEST_YAML:
        raise UserError(f"YAML of {len(text)} characters, more than {LARGEST_YAML}")
    depth, (kind, name) = 0, ROOTS[root]
    try:
        for event in yaml.parse(ODD.sub("?", text), EVENTS):
            if isinstance(event, yaml.AliasEvent):
                raise UserError("YAML with an alias, *name; write out its value")
            if depth == 0 and isinstance(event, yaml.NodeEvent) and not isinstance(event, kind):
                raise UserError(f"not a YAML {name}")
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > DEEPEST:
                raise UserError(f"YAML of more than {DEEPEST} levels")
    except UserError:
        raise
    except (yaml.YAMLError, ValueError) as error:
        raise UserError(f"not YAML ({shorten_value(error)})") from error


def yaml_of(text: str, root: type = dict) -> Any:
    """Parse a YAML mapping (or list) of plain values; empty text counts as an empty one, and ``${...}`` stays text."""
    return deepcopy(_yaml_of(text, root))


@lru_cache(maxsize=4)  # because the settings of a run are read for its catalogue, files and page
def _yaml_of(text: str, root: type) -> Any:
    check_yaml(text, root)
    try:
        data = OmegaConf.to_container(OmegaConf.create(text)) or root()
    except Exception as error:  # PyYAML, OmegaConf, or Python (impossible dates and numbers)
        raise UserError(f"not YAML of plain values ({shorten_value(error)})") from error
    return check_plain(data)


def check_plain(data: Any, levels: int = DEEPEST, budget: list[int] | None = None) -> Any:
    """Return ``data`` if it consists of at most `MOST_VALUES` plain values; otherwise raise a UserError.

    Plain values are None, strings, 64-bit numbers, and lists and dictionaries nested at most ``levels`` deep.
    """
    budget = budget or [MOST_VALUES]
    budget[0] -= 1
    if budget[0] < 0 or levels == 0:
        raise UserError(f"settings of more than {MOST_VALUES} values or {DEEPEST} levels")
    plain = isinstance(data, dict | list | tuple | str | int | float | None)
    if not plain or (isinstance(data, int) and abs(data) >= 2**64):
        raise UserError(f"a value has the type {type(data).__name__}; only text, lists and 64-bit numbers are allowed")
    parts = [*data, *data.values()] if isinstance(data, dict) else data if isinstance(data, list | tuple) else ()
    for part in parts:
        check_plain(part, levels - 1, budget)
    return data
