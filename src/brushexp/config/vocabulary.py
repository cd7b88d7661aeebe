"""The words that a painter types beside keys, and other spellings of ours; nothing here is slow to import."""

import os
import re
from functools import cache
from pathlib import Path

from brushexp.system.published import published
from brushexp.system.spellings import find_spelling
from brushexp.system.words import conf_folders, table_of_words

PACKAGE = Path(__file__).parents[1]
TASK_POINTS = "brushexp.tasks"  # entry-point group: name of a task -> its class
STAND_INS = "brushexp.stand_ins"  # entry-point group: "task.other" -> the class of the other one, which may replace it
PARTS = re.compile(r"""[^][{},:'"]+""")  # of a list or mapping of Hydra
ALONE = ("look", "quality")  # groups whose members may stand alone: watercolour is look=watercolour


@cache
def spellings(table: str) -> dict[str, str]:
    """Map what others say for ``keys``, for ``members``, or for what is typed ``instead``, to what we say."""
    return {theirs: ours for ours, others in table_of_words(table).items() for theirs in others}


def options_of_word(word: str) -> list[str]:
    """List the options of changes that a word stands for; none for other words.

    >>> options_of_word("variety"), options_of_word("steps")
    (['change.variety.amount'], [])
    """
    own = table_of_words("change_words").get(word)
    return table_of_words("change_options").get(word, []) if own is None else [own]


def with_words_of_changes(message: str) -> str:
    """Replace options of changes in a message by the words that stand for them.

    >>> with_words_of_changes("change.variety.amount=2 is above 1")
    'variety=2 is above 1'
    """
    for word, option in table_of_words("change_words").items():
        message = re.sub(rf"\b{re.escape(option)}\b", word, message)
    for word, options in table_of_words("change_options").items():
        message = re.sub(rf"\b({'|'.join(map(re.escape, options))})\b", word, message)
    return message


def members_alone() -> dict[str, str]:
    """Map each look and each quality, those that ship and those of ``conf/``, to what it means as a word alone."""
    return {name: f"{group}={name}" for group in ALONE for name in members_of_group(group)}


def meaning_of(word: str) -> str | None:
    """Return what a painter's word means, as key=value; None for other words.

    >>> meaning_of("finer"), meaning_of("watercolor"), meaning_of("photo.jpg")
    ('detail=2', 'look=watercolour', None)
    """
    known = table_of_words("alone") | members_alone()
    return known.get(word) or known.get(respelt(word))


def members_of_group(group: str) -> set[str]:
    """List the presets of a group, those that ship and those of ``conf/``."""
    return {path.stem for root in (*conf_folders(), Path("conf")) for path in (root / group).glob("*.yaml")}


def respelt(text: str) -> str:
    """Spell colour, grey, optimiser and analyse the other way, British or American.

    >>> respelt("watercolor"), respelt("style.colours"), respelt("grey")
    ('watercolour', 'style.colors', 'gray')
    >>> respelt("optimiser"), respelt("renderer.normalization"), respelt("analyze"), respelt("noise")
    ('optimizer', 'renderer.normalisation', 'analyse', 'noise')
    """
    pairs = {"colour": "color", "color": "colour", "grey": "gray", "gray": "grey"}
    pairs |= {"is": "iz", "iz": "is", "lys": "lyz", "lyz": "lys"}
    return re.sub("colour|color|grey|gray|i[sz](?=er|ation)|ly[sz](?=e)", lambda found: pairs[found[0]], text)


def as_task(word: str) -> str:
    """Spell a word of a command line as we do if it then is a task.

    >>> as_task("analyze"), as_task("task=analyze"), as_task("optimiser")
    ('analyse', 'task=analyse', 'optimiser')
    """
    spelt = respelt(word)
    return spelt if spelt != word and spelt.removeprefix("task=") in task_names() and not is_path(word) else word


def task_names() -> set[str]:
    """List the tasks by their names, without their classes."""
    own = {path.stem for path in (PACKAGE / "tasks").glob("[a-z]*.py")}
    return own | set(published(TASK_POINTS))


def is_path(text: str) -> bool:
    """Whether a text is the path of a file or folder that exists."""
    return bool(text) and os.path.exists(os.path.expanduser(text))


def as_found(word: str) -> str:
    """Spell the paths of a word of a command line as the files and folders that exist are (`find_spelling`).

    Of a list, ``image=a.png,b.png``, each part may be a path; only a folder to write into need not exist.
    """
    if word.isascii() or is_path(word):
        return word
    if is_path(found := _found(word)):
        return found
    key, equal, value = word.partition("=")
    if not equal:
        return word
    if key == "output" or is_path(_found(value)):
        return key + equal + _found(value)
    return key + equal + PARTS.sub(lambda part: found if is_path(found := _found(part[0])) else part[0], value)


def _found(path: str) -> str:
    """Spell a path as it is found, with the home in full; one in which nothing is spelt otherwise stays."""
    whole = os.path.expanduser(path)
    found = find_spelling(whole)
    return path if found == whole else found


def plain_name(name: str) -> str:
    """Write a name as the tables here have it.

    >>> plain_name("Brush-Size"), plain_name("colours")
    ('brush_size', 'colors')
    """
    name = re.sub("[- ]", "_", name.lower())
    return name if name in spellings("keys") or name in spellings("instead") else respelt(name)
