"""Where configs are, those that ship and the user's own, and how Hydra composes them."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Lock
from typing import Any

from hydra import compose, initialize_config_module
from hydra._internal.utils import get_args_parser
from hydra.core.global_hydra import GlobalHydra
from hydra.core.singleton import Singleton
from hydra.version import VersionBase
from omegaconf import DictConfig

from brushexp.app.keys import groups_of
from brushexp.app.schema import TASKS
from brushexp.errors import UserError

SHIPPED = Path(__file__).parents[1] / "conf"
GROUPS = {name for schema in TASKS.values() for name in groups_of(schema)} - {"model"} | {"task", "experiment"}
PRESETS = (*GROUPS, "pictures")  # folders that configs may have
_lock = Lock()  # Hydra is one for the whole process


def folders_of(root: Path, arguments: Sequence[str] = ()) -> list[Path]:
    """The configs that ship, and then the user's: in the folder of ``--config-dir``, or else in ``root/conf``.

    A UserError if a file of the user has the name of one that ships.
    """
    typed = get_args_parser().parse_known_args(arguments)[0].config_dir
    own = root / "conf" if typed is None else Path(typed)
    if typed is None and not any((own / group).is_dir() for group in PRESETS):
        return [SHIPPED]
    for path in sorted(own.glob("*/*.yaml")):
        if (SHIPPED / path.relative_to(own)).exists():
            raise UserError(f"{path} has the name of a preset that ships; give the file another name")
    return [SHIPPED, own]


def folders_in(cfg: DictConfig) -> list[Path]:
    """The same, of a config that Hydra has composed."""
    sources = [source for source in cfg.hydra.runtime.config_sources if source.schema == "file"]
    return list(dict.fromkeys([SHIPPED, *(Path(source.path).resolve() for source in sources)]))


def files_of(folder: Path, group: str) -> dict[str, Path]:
    """The files of a group in a folder of configs, by name."""
    return {path.stem: path for path in sorted((folder / group).glob("*.yaml"))}


def composed(words: Sequence[str], folders: Sequence[Path] = (SHIPPED,)) -> DictConfig:
    """The config that Hydra composes for words of a command line, of configs in folders, those that ship first.

    Any thread may call it, and what else in this process uses Hydra does not notice.
    """
    own = [f"hydra.searchpath=['file://{folder.resolve()}']" for folder in folders[1:]]
    with _apart(), initialize_config_module("brushexp.conf", version_base="1.3"):
        return compose("config", overrides=[*words, *own])


@contextmanager
def _apart() -> Iterator[None]:
    """Hydra as if it were not in use; another program's is afterwards as it was."""
    singletons: dict[Any, Any] = Singleton._instances
    kinds = (GlobalHydra, VersionBase)
    with _lock:
        before = {kind: singletons.pop(kind) for kind in kinds if kind in singletons}
        try:
            yield
        finally:
            for kind in kinds:
                singletons.pop(kind, None)
            singletons.update(before)
