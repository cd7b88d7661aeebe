"""Find the config folders and compose a config with Hydra."""

import re
from collections.abc import Sequence
from io import StringIO
from itertools import pairwise
from pathlib import Path
from typing import Any

from hydra import compose, initialize_config_module
from omegaconf import DictConfig, OmegaConf

from brushexp.compat.hydra import isolated_hydra, parse_arguments
from brushexp.errors import UserError
from brushexp.registry import FAMILIES, literal
from brushexp.system.reading import decode_text
from brushexp.system.words import conf_folders

CHOSEN_GROUPS = {*FAMILIES, "look", "quality", "trainer", "task", "experiment"}  # chosen as ``group=name``
SOURCE = "text"  # URL scheme of folders of configs that `hydra_plugins.brushexp_text` reads
GLOBAL = "# @package _global_\n"  # first line of global config files


def folders_of(root: Path, words: Sequence[str] = ()) -> list[Path]:
    """List the config folders: the shipped ones, and the user's own (``--config-dir`` or else ``root/conf``).

    Raises a UserError if the folder given by ``--config-dir`` does not exist.
    """
    typed = parse_arguments(words)[0].config_dir
    own = root / "conf" if typed is None else Path(typed)
    if typed is not None and not own.is_dir():
        raise UserError(f"--config-dir {typed}: there is no such folder; correct the path")
    has_configs = typed is not None or any((own / group).is_dir() for group in CHOSEN_GROUPS | {"pictures"})
    return [*conf_folders(), own] if has_configs else conf_folders()


def own_folders(folders: Sequence[Path]) -> list[Path]:
    """Return the given config folders that are not shipped with brushexp or its packages."""
    return [folder for folder in folders if folder not in conf_folders()]


def folders_in(cfg: DictConfig) -> list[Path]:
    """List the folders from which a config was composed, shipped folders first."""
    sources = [source for source in cfg.hydra.runtime.config_sources if source.schema == SOURCE]
    return list(dict.fromkeys([*conf_folders(), *(Path(source.path).resolve() for source in sources)]))


def files_of(folder: Path, group: str) -> dict[str, Path]:
    """Map the name of each config in a group to its file in a config folder."""
    return {path.stem: path for path in sorted((folder / group).glob("*.yaml"))}


def presets_of(folder: Path) -> dict[str, str]:
    """Map each preset in a folder to its first comment line, ignoring Hydra's directive line."""
    texts = {path.stem: decode_text(path.read_bytes()) for path in folder.glob("*.yaml")}
    return {name: text.removeprefix(GLOBAL).partition("\n")[0].lstrip("# ") for name, text in texts.items()}


def load_config(path: Path) -> Any:
    """Load a YAML config file, in any encoding that `decode_text` supports."""
    return OmegaConf.load(StringIO(decode_text(path.read_bytes())))


def search_path(folders: Sequence[Path]) -> list[str]:
    """Return the override that adds package and user configs last; ``--config-dir`` would put them first."""
    places = [quote(f"{SOURCE}://{folder.resolve()}") for folder in folders[1:]]
    return [f"hydra.searchpath=[{','.join(places)}]"] if places else []


def without_folder(words: Sequence[str]) -> list[str]:
    """Remove ``--config-dir`` and its value from command-line arguments."""
    flags = ("--config-dir", "-cd")
    return [
        word
        for before, word in pairwise(("", *words))
        if before not in flags and word not in flags and not word.startswith("--config-dir=")
    ]


def quote(text: str) -> str:
    """Quote text so that Hydra and OmegaConf read every character literally."""
    escaped = re.sub(r'(\\*)("|$)', lambda end: 2 * end[1] + end[2].replace('"', '\\"'), literal(text))
    return '"' + escaped + '"'


def compose_config(words: Sequence[str], folders: Sequence[Path] = ()) -> DictConfig:
    """Compose the config for command-line arguments; ``folders`` defaults to the shipped config folders.

    The function is thread-safe and does not disturb other users of Hydra in this process.
    """
    with isolated_hydra(), initialize_config_module("brushexp.conf", version_base="1.3"):
        return compose("config", overrides=[*words, *search_path(folders or conf_folders())])
