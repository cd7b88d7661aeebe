"""Expand keys that stand for several others: ``brush=stroke.png`` chooses a renderer and sets its files.

The vocabulary files (`brushexp.config.vocabulary`) declare these keys in tables ``[stands_for.KEY]``. ``settings``
lists the settings that a key expands to; in these settings, ``{value}`` is replaced by the key's value, and ``{paths}``
by the value with absolute paths, so that a painting can be redrawn from any folder. ``beside`` lists settings that the
key makes redundant.
"""

import os
from collections.abc import Sequence

from brushexp.config.vocabulary import is_path
from brushexp.system.words import table_of_words


def spell_out(words: Sequence[str]) -> list[str]:
    """Replace each key that stands for several settings with those settings."""
    table = table_of_words("stands_for")
    typed = {key: value for key, equal, value in (word.partition("=") for word in words) if equal and key in table}
    beside = {setting for key in typed for setting in table[key].get("beside", ())}
    others = [word for word in words if word.partition("=")[0] not in typed and word not in beside]
    settings = (
        setting.format(value=value, paths=_absolute(value))
        for key, value in typed.items()
        for setting in table[key]["settings"]
    )
    return [*others, *settings]


def _absolute(value: str) -> str:
    """Make the paths in a list absolute; names of missing files are kept unchanged for error messages."""
    parts = [value] if is_path(value) else value.split(",")
    return ",".join(os.path.abspath(os.path.expanduser(part)) if is_path(part) else part for part in parts)
