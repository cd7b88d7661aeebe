"""Look up painters' words and alternative spellings; this module imports nothing slow."""

import os
import re
from functools import cache
from pathlib import Path

from brushexp.system.published import entry_points_of
from brushexp.system.spellings import find_spelling
from brushexp.system.words import conf_folders, table_of_words

PACKAGE = Path(__file__).parents[1]
TASK_POINTS = "brushexp.tasks"  # entry-point group: name of a task -> its class
STAND_INS = "brushexp.stand_ins"  # entry-point group: "task.other" -> class of the other task, which may replace it
PARTS = re.compile(r"""[^][{},:'"]+""")  # parts of Hydra's lists and mappings
ALONE = ("look", "quality")  # groups whose members may be typed alone: watercolour is look=watercolour


@cache
def spellings(table: str) -> dict[str, str]:
    """Map alternative names of ``keys`` or ``members``, or words to be replaced (``instead``), to the program's own."""
    return {theirs: ours for ours, others in table_of_words(table).items() for theirs in others}


def options_of_word(word: str) -> list[str]:
    """List the options of changes that a short word sets; the list is empty for other words.

    >>> options_of_word("variety"), options_of_word("steps")
    (['change.variety.amount'], [])
    """
    own = table_of_words("change_words").get(word)
    return table_of_words("change_options").get(word, []) if own is None else [own]


def with_words_of_changes(message: str) -> str:
    """Replace options of changes in a message with their short words.

    >>> with_words_of_changes("change.variety.amount=2 is above 1")
    'variety=2 is above 1'
    """
    for word, option in table_of_words("change_words").items():
        message = re.sub(rf"\b{re.escape(option)}\b", word, message)
    for word, options in table_of_words("change_options").items():
        message = re.sub(rf"\b({'|'.join(map(re.escape, options))})\b", word, message)
    return message


def members_alone() -> dict[str, str]:
    """Map the bare name of each look and quality, shipped or in ``conf/``, to the setting that it stands for."""
    return {name: f"{group}={name}" for group in ALONE for name in members_of_group(group)}


def meaning_of(word: str) -> str | None:
    """Return the meaning of a painter's word as key=value, or None for other words.

    >>> meaning_of("finer"), meaning_of("watercolor"), meaning_of("photo.jpg")
    ('detail=2', 'look=watercolour', None)
    """
    known = table_of_words("alone") | members_alone()
    return known.get(word) or known.get(switch_spelling(word))


def members_of_group(group: str) -> set[str]:
    """List the presets of a group, shipped or in ``conf/``."""
    return {path.stem for root in (*conf_folders(), Path("conf")) for path in (root / group).glob("*.yaml")}


def switch_spelling(text: str) -> str:
    """Switch colour, grey, optimiser and analyse between British and American spelling.

    >>> switch_spelling("watercolor"), switch_spelling("style.colours"), switch_spelling("grey")
    ('watercolour', 'style.colors', 'gray')
    >>> [switch_spelling(text) for text in ("optimiser", "renderer.normalization", "analyze", "noise")]
    ['optimizer', 'renderer.normalisation', 'analyse', 'noise']
    """
    pairs = {"colour": "color", "color": "colour", "grey": "gray", "gray": "grey"}
    pairs |= {"is": "iz", "iz": "is", "lys": "lyz", "lyz": "lys"}
    return re.sub("colour|color|grey|gray|i[sz](?=er|ation)|ly[sz](?=e)", lambda found: pairs[found[0]], text)


def respell_task(word: str) -> str:
    """Switch the spelling of a command-line argument if the result is the name of a task.

    >>> respell_task("analyze"), respell_task("task=analyze"), respell_task("optimiser")
    ('analyse', 'task=analyse', 'optimiser')
    """
    spelt = switch_spelling(word)
    return spelt if spelt != word and spelt.removeprefix("task=") in task_names() and not is_path(word) else word


def task_names() -> set[str]:
    """List the names of the tasks without importing them."""
    own = {path.stem for path in (PACKAGE / "tasks").glob("[a-z]*.py")}
    return own | set(entry_points_of(TASK_POINTS))


def is_path(text: str) -> bool:
    """Check whether a text is the path of an existing file or folder."""
    return bool(text) and os.path.exists(os.path.expanduser(text))


def spell_paths(word: str) -> str:
    """Give paths in a command-line argument the spelling of existing files and folders (`find_spelling`).

    In a list such as ``image=a.png,b.png``, each part may be a path. Only an output folder need not exist.
    """
    if word.isascii() or is_path(word):
        return word
    if is_path(found := _correct_spelling(word)):
        return found
    key, equal, value = word.partition("=")
    if not equal:
        return word
    if key == "output" or is_path(_correct_spelling(value)):
        return key + equal + _correct_spelling(value)
    return (
        key + equal + PARTS.sub(lambda part: found if is_path(found := _correct_spelling(part[0])) else part[0], value)
    )


def _correct_spelling(path: str) -> str:
    """Expand the home folder in a path and give it the existing file's spelling; a correct path stays unchanged."""
    whole = os.path.expanduser(path)
    found = find_spelling(whole)
    return path if found == whole else found


def plain(text: str) -> str:
    """Remove the markup of docstrings from a text, for a terminal.

    >>> plain("less sensitive to outliers than ``mse``")
    'less sensitive to outliers than mse'
    """
    return text.replace("``", "")


def plain_name(name: str) -> str:
    """Normalise a name for lookup in the tables.

    >>> plain_name("Brush-Size"), plain_name("colours")
    ('brush_size', 'colors')
    """
    name = re.sub("[- ]", "_", name.lower())
    return name if name in spellings("keys") or name in spellings("instead") else switch_spelling(name)
