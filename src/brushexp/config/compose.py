"""Find the folders of configs, and compose a config with Hydra."""

import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from textwrap import shorten

import yaml
from hydra import compose, initialize_config_module
from omegaconf import DictConfig

from brushexp.compat.hydra import isolated, parse_arguments
from brushexp.config.keys import groups_of
from brushexp.config.tasks import TASKS
from brushexp.config.vocabulary import SHIPPED
from brushexp.errors import UserError
from brushexp.registry import literal

OF_THE_TASK = ("look", "experiment", "quality")  # groups whose files set keys of the whole task
GLOBAL = "# @package _global_\n"  # first line of such a file


def chosen_groups() -> set[str]:
    """List the groups of configs of which a run chooses members, as ``group=name``."""
    return {name for schema in TASKS.values() for name in groups_of(schema)} | {"task", "experiment"}


def folders_of(root: Path, words: Sequence[str] = ()) -> list[Path]:
    """List the folder of configs that ship and that of the user, ``--config-dir`` or else ``root/conf``.

    A UserError if a file of the user has the name of one that ships, or is no YAML.
    """
    typed = parse_arguments(words)[0].config_dir
    own, groups = root / "conf" if typed is None else Path(typed), chosen_groups() | {"pictures"}
    if typed is not None and not own.is_dir():
        raise UserError(f"--config-dir {typed}: there is no such folder; correct the path")
    if typed is None and not any((own / group).is_dir() for group in groups):
        return [SHIPPED]
    for path in sorted(own.glob("*/*.yaml")):
        if (SHIPPED / path.relative_to(own)).exists():
            raise UserError(f"{path} has the name of a preset that ships; give the file another name")
        if path.parent.name in groups:
            _check_file(path)
    return [SHIPPED, own]


def _check_file(path: Path) -> None:
    """Refuse a file that is no config: Hydra would show a traceback, or take a word for a key of its own."""
    if not path.is_file():
        raise UserError(f"{path} is a folder, a device or a pipe, not a file; take it away")
    kind, example = (list, "- photo.jpg") if path.parent.name == "pictures" else (dict, "steps: 100")
    try:
        text = path.read_text(encoding="utf-8")
        content = yaml.safe_load(text)
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        raise UserError(f"{path} is no YAML ({shorten(str(error), 150)}); correct it, or take it away") from error
    if content is not None and not isinstance(content, kind):
        raise UserError(f"{path} is no config; it has lines like '{example}': correct it, or take it away")
    if isinstance(content, dict) and not isinstance(content.get("defaults") or [], list):
        raise UserError(f"{path} has defaults that are no list; write each in a line, '- override /look: oil'")
    if path.parent.name in OF_THE_TASK and not re.search("^# *@package _global_ *$", text, re.MULTILINE):
        raise UserError(f"{path} would set nothing; its first line must be: # @package _global_")


def folders_in(cfg: DictConfig) -> list[Path]:
    """List the folders of which Hydra has composed a config, those that ship first."""
    sources = [source for source in cfg.hydra.runtime.config_sources if source.schema == "file"]
    return list(dict.fromkeys([SHIPPED, *(Path(source.path).resolve() for source in sources)]))


def files_of(folder: Path, group: str) -> dict[str, Path]:
    """Map names to files of a group in a folder of configs."""
    return {path.stem: path for path in sorted((folder / group).glob("*.yaml"))}


def presets_of(folder: Path) -> dict[str, str]:
    """Map the presets in a folder to their first comment lines, after the one that Hydra reads."""
    texts = {path.stem: path.read_text(encoding="utf-8") for path in folder.glob("*.yaml")}
    return {name: text.removeprefix(GLOBAL).partition("\n")[0].lstrip("# ") for name, text in texts.items()}


def search_path(folders: Sequence[Path]) -> list[str]:
    """Write the word by which Hydra finds the user's configs after looks; ``--config-dir`` would put them first."""
    places = [quote(f"file://{folder.resolve()}") for folder in folders[1:]]
    return [f"hydra.searchpath=[{','.join(places)}]"] if places else []


def without_folder(words: Sequence[str]) -> list[str]:
    """Drop ``--config-dir`` from the words of a command line."""
    flags = ("--config-dir", "-cd")
    return [
        word
        for before, word in pairwise(("", *words))
        if before not in flags and word not in flags and not word.startswith("--config-dir=")
    ]


def quote(text: str) -> str:
    """Put a text in quotes so that Hydra and OmegaConf read any letters in it as they are."""
    escaped = re.sub(r'(\\*)("|$)', lambda end: 2 * end[1] + end[2].replace('"', '\\"'), literal(text))
    return '"' + escaped + '"'


def composed(words: Sequence[str], folders: Sequence[Path] = (SHIPPED,)) -> DictConfig:
    """Compose the config for words of a command line, of configs in folders, those that ship first.

    Any thread may call it, and another user of Hydra in this process is not disturbed.
    """
    with isolated(), initialize_config_module("brushexp.conf", version_base="1.3"):
        return compose("config", overrides=[*words, *search_path(folders)])
