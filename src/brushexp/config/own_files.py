"""Check the user's own config files: report invalid files, and raise an error if one is chosen."""

import logging
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from textwrap import shorten
from typing import Any

from brushexp.config.compose import CHOSEN_GROUPS, own_folders
from brushexp.config.vocabulary import ALONE
from brushexp.errors import UserError
from brushexp.system.reading import read_text, yaml_of
from brushexp.system.words import conf_folders

GLOBAL_GROUPS = ("look", "experiment", "quality")  # groups whose files set keys of the whole task

log = logging.getLogger(__name__)


def check_own_files(folders: Sequence[Path], words: Sequence[str], *, warns: bool = True) -> set[Path]:
    """List the user's invalid config files; raise a UserError if one is chosen, and warn of the others if ``warns``."""
    wrong = {path: message for folder in own_folders(folders) for path, message in problems_in(folder)}
    for path, message in wrong.items():
        if _is_chosen(path, words):
            raise UserError(message)
        log.log(logging.WARNING if warns else logging.DEBUG, "%s; it is left out", message)
    return set(wrong)


def _is_chosen(path: Path, words: Sequence[str]) -> bool:
    """Check whether arguments choose a config file, as in ``look=mine``, ``loss=[mse,mine]`` or ``mine``."""
    group, name = path.parent.name, path.stem
    chosen = rf"\+*{re.escape(group)}=(.*\W)?{re.escape(name)}(\W.*)?"
    return any(re.fullmatch(chosen, word) or (group in ALONE and word == name) for word in words)


def problems_in(folder: Path) -> Iterator[tuple[Path, str]]:
    """Yield each invalid file in a config folder with a message that says what is wrong and how to fix it."""
    for path in sorted(folder.glob("*/*.yaml")):
        if any((shipped / path.relative_to(folder)).exists() for shipped in conf_folders()):
            yield path, f"{path} has the name of a shipped preset; give the file another name"
        elif path.parent.name in CHOSEN_GROUPS | {"pictures"} and (problem := _problem_of(path)):
            yield path, problem


def _problem_of(path: Path) -> str:
    """Explain what is wrong with a file that Hydra would misread or reject with a traceback; "" if it is valid."""
    if not path.is_file():
        return f"{path} is a folder, a device or a pipe, not a file; remove it"
    kind, example = (list, "- photo.jpg") if path.parent.name == "pictures" else (dict, "steps: 100")
    try:
        text = read_text(path, "remove it")
        content: Any = yaml_of(text, kind)
    except UserError as error:
        return f"{path} is not a config ({shorten(str(error), 150)}); write lines like '{example}'"
    if isinstance(content, dict) and not isinstance(content.get("defaults") or [], list):
        return f"{path} has defaults that are not a list; write one per line, '- override /look: oil'"
    if path.parent.name in GLOBAL_GROUPS and not re.search("^# *@package _global_ *$", text, re.MULTILINE):
        return f"{path} would set nothing; its first line must be: # @package _global_"
    return ""
