"""Find files whose names use a different Unicode form: é as one character, or as e plus a combining accent.

File names from a Mac use combining accents (NFD), and typed names do not (NFC). Linux treats the two as different.
"""

import os
import unicodedata
from contextlib import suppress
from pathlib import Path


def find_spelling(path: str) -> str:
    r"""Spell each part of a path in the Unicode form of the existing folder or file.

    A part does not change if it exists as given, or if no file or several files match it.

    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     _ = Path(folder, "e\u0301.png").touch()
    ...     found = find_spelling(f"{folder}/\u00e9.png")
    >>> ascii(os.path.basename(found))
    "'e\\u0301.png'"
    """
    if path.isascii() or os.path.lexists(path):
        return path
    parent, name = os.path.split(path)
    if not name:  # the path ends in a slash
        return os.path.join(find_spelling(parent), "") if parent != path else path
    found, alike = find_spelling(parent), []
    with suppress(OSError, ValueError):
        alike = [other for other in os.listdir(found or ".") if composed_name(other) == composed_name(name)]
    return os.path.join(found, alike[0] if len(alike) == 1 else name)


def find_path(path: str | os.PathLike[str]) -> Path:
    """Return a path as spelled by `find_spelling`."""
    return Path(find_spelling(os.fspath(path)))


def composed_name(name: str) -> str:
    """Convert a name to composed Unicode form (NFC)."""
    return unicodedata.normalize("NFC", name)


def both_forms(name: str) -> set[str]:
    """Return a name as given, in composed (NFC) and in decomposed (NFD) Unicode form."""
    return {name, composed_name(name), unicodedata.normalize("NFD", name)}
