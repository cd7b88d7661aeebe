"""Keys that stand for settings: ``brush=stroke.png`` is short for a renderer and the option with its files.

The files of words (`brushexp.config.vocabulary`) say so, in tables ``[stands_for.KEY]``: ``settings`` are what the key
stands for, in which ``{value}`` is what was typed, and ``{paths}`` the same as absolute paths, so that a painting can
be drawn again from any folder; ``beside`` are settings that may be typed beside the key, and say nothing more.
"""

import os
from collections.abc import Sequence

from brushexp.config.vocabulary import is_path
from brushexp.system.words import table_of_words


def spell_out(words: Sequence[str]) -> list[str]:
    """Replace each key that stands for settings by these; of several with the same key the last one counts."""
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
    """Make the paths of a list absolute; what names no file stays as it is, for the message that says so."""
    parts = [value] if is_path(value) else value.split(",")
    return ",".join(os.path.abspath(os.path.expanduser(part)) if is_path(part) else part for part in parts)
