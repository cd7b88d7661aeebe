"""Find files whose names have the same letters in another form of Unicode: é as one sign, or as e and an accent.

A name from a Mac has accents as signs of their own (NFD), one that is typed has none (NFC); to Linux they differ.
"""

import os
import unicodedata
from contextlib import suppress
from pathlib import Path


def find_spelling(path: str) -> str:
    r"""Spell a path as the folders and files that exist are spelt, as far as they do.

    A part that exists as it is stays, and so does one for which two others would do.

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
    if not name:  # "x/"
        return os.path.join(find_spelling(parent), "") if parent != path else path
    found, alike = find_spelling(parent), []
    with suppress(OSError, ValueError):
        alike = [other for other in os.listdir(found or ".") if composed_name(other) == composed_name(name)]
    return os.path.join(found, alike[0] if len(alike) == 1 else name)


def find_path(path: str | os.PathLike[str]) -> Path:
    """Spell a path as `find_spelling` does."""
    return Path(find_spelling(os.fspath(path)))


def composed_name(name: str) -> str:
    """Write a name with as few signs as Unicode has for it (NFC)."""
    return unicodedata.normalize("NFC", name)


def both_forms(name: str) -> set[str]:
    """List a name as it is, with as few signs as possible (NFC), and with accents as signs of their own (NFD)."""
    return {name, composed_name(name), unicodedata.normalize("NFD", name)}
