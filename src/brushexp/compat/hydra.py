"""Private parts of Hydra that the command line and Python need; tried with Hydra 1.3.8 and 1.4.0rc3."""

from argparse import Namespace
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from copy import deepcopy
from functools import cached_property
from threading import Lock
from typing import Any, NoReturn

from hydra._internal.utils import get_args_parser
from hydra.core.config_store import ConfigNode, ConfigStore
from hydra.core.global_hydra import GlobalHydra
from hydra.core.singleton import Singleton
from hydra.version import VersionBase

from brushexp.errors import UserError

_lock = Lock()  # Hydra is one for the whole process


def parse_arguments(words: Sequence[str]) -> tuple[Namespace, list[str]]:
    """Parse a command line as Hydra does: its flags and overrides, and words behind flags that it does not know.

    A UserError says what is wrong with a flag, such as ``-help`` or ``-o x``.
    """

    def refuse(message: str) -> NoReturn:
        raise UserError(f"{message.removeprefix('argument ')}; --help lists the keys, which have no dashes")

    parser = get_args_parser()
    parser.error = refuse  # type: ignore[method-assign]
    namespace, others = parser.parse_known_args(words)
    return namespace, others


class WhenRead:
    """A config that is made when Hydra, which reads copies, reads it first."""

    def __init__(self, make: Callable[[], Any]) -> None:
        self.make = make

    @cached_property
    def config(self) -> Any:
        return self.make()

    def __deepcopy__(self, memo: dict[int, Any]) -> Any:
        return deepcopy(self.config)


def store_when_read(group: str, name: str, make: Callable[[], Any], provider: str) -> None:
    """Publish a choice of a group, in the global package, whose config ``make`` makes when it is read."""
    choices, file, node = ConfigStore.instance().repo.setdefault(group, {}), f"{name}.yaml", WhenRead(make)
    choices[file] = ConfigNode(file, node, group, "_global_", provider)  # type: ignore[arg-type]


@contextmanager
def isolated() -> Iterator[None]:
    """Leave Hydra unused within the block; another program's Hydra is as it was afterwards."""
    singletons: dict[Any, Any] = Singleton._instances
    kinds = (GlobalHydra, VersionBase)
    with _lock, one_store():
        before = {kind: singletons.pop(kind) for kind in kinds if kind in singletons}
        try:
            yield
        finally:
            for kind in kinds:
                singletons.pop(kind, None)
            singletons.update(before)


@contextmanager
def one_store() -> Iterator[None]:
    """Let all that composes within the block share the store of configs.

    Nothing changes it, and to copy it takes a third of the time of a composition.
    """
    is_first = "__deepcopy__" not in vars(ConfigStore)
    ConfigStore.__deepcopy__ = _itself  # type: ignore[attr-defined]
    try:
        yield
    finally:
        if is_first:
            del ConfigStore.__deepcopy__  # type: ignore[attr-defined]


def _itself(store: ConfigStore, memo: dict[int, Any]) -> ConfigStore:
    return store
