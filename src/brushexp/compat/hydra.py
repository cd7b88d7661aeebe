"""Private parts of Hydra used by the command line and the Python API; tested with Hydra 1.3.8 and 1.4.0rc3."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from threading import Lock
from typing import Any, NoReturn
from unittest.mock import patch

from hydra._internal.hydra import Hydra
from hydra._internal.utils import get_args_parser
from hydra.core.config_store import ConfigNode, ConfigStore
from hydra.core.global_hydra import GlobalHydra
from hydra.core.singleton import Singleton
from hydra.version import VersionBase
from omegaconf import OmegaConf

from brushexp.errors import UserError

_lock = Lock()  # Hydra's state is global to the process


def parse_arguments(words: Sequence[str]) -> tuple[Namespace, list[str]]:
    """Parse a command line as Hydra does; return flags and overrides, and the arguments that Hydra does not recognise.

    Raises a UserError that explains a wrong flag, such as ``-help`` or ``-o x``.
    """

    def refuse(message: str) -> NoReturn:
        raise UserError(f"{message.removeprefix('argument ')}; --help lists the keys, which have no dashes")

    parser = get_args_parser()
    parser.error = refuse  # type: ignore[method-assign]
    namespace, others = parser.parse_known_args(words)
    return namespace, others


class NodeWhenRead(ConfigNode):
    """A member of a config group that does not build its config until Hydra reads it.

    Copying the store builds no configs. Pickling the store builds all of them, because a sweep's worker process
    composes its config before it loads plugins.
    """

    def __init__(
        self,
        name: str,
        make: Callable[[], Any],
        group: str | None,
        package: str | None,
        provider: str | None,
    ) -> None:
        self.name, self.group, self.package, self.provider = name, group, package, provider
        self.make = make
        self.config: Any = None

    @property
    def node(self) -> Any:
        if self.config is None:
            self.config = self.make()
        return self.config

    @node.setter
    def node(self, config: Any) -> None:
        self.config = config

    def __copy__(self) -> NodeWhenRead:
        twin = NodeWhenRead(self.name, self.make, self.group, self.package, self.provider)
        twin.config = self.config
        return twin

    def __deepcopy__(self, memo: dict[int, Any]) -> NodeWhenRead:
        return self.__copy__()

    def __reduce__(self) -> tuple[Any, ...]:
        try:
            config = self.node
        except UserError:  # a broken user file, which does not matter until it is chosen
            config = OmegaConf.create()
        return ConfigNode, (self.name, config, self.group, self.package, self.provider)


def store_when_read(
    group: str,
    name: str,
    make: Callable[[], Any],
    provider: str,
    package: str | None = "_global_",
) -> None:
    """Add a member to a config group such as ``look_options/init``; Hydra calls ``make`` when it reads the config."""
    file = f"{name}.yaml"
    _group(group)[file] = NodeWhenRead(file, make, group, package, provider)


def move_choice(group: str, name: str, to: str, by: str) -> bool:
    """Move a member to group ``to`` and clear its package; return False if it is missing or its provider is ``by``."""
    choices, file = _group(group), f"{name}.yaml"
    if file not in choices or choices[file].provider == by:
        return False
    moved = _group(to)[file] = choices.pop(file)
    moved.group, moved.package = to, None
    return True


def remove_choice(group: str, name: str) -> None:
    """Remove a member from a config group if it exists."""
    _group(group).pop(f"{name}.yaml", None)


def _group(path: str) -> dict[str, Any]:
    """Return the members of a group in Hydra's config store, creating the group if necessary."""
    choices: dict[str, Any] = ConfigStore.instance().repo
    for part in path.split("/"):
        choices = choices.setdefault(part, {})
    return choices


@contextmanager
def skip_sweep_check(words: Sequence[str]) -> Iterator[None]:
    """Skip Hydra's extra composition that detects a sweep, unless ``words`` name an experiment or a Hydra setting."""
    if any(word.startswith(("experiment=", "+experiment=", "hydra.mode=", "hydra/")) for word in words):
        yield
        return
    with patch.object(Hydra, "get_mode", lambda *_, **__: None):
        yield


@contextmanager
def isolated_hydra() -> Iterator[None]:
    """Run the ``with`` block with fresh Hydra state, then restore the host program's Hydra state."""
    singletons: dict[Any, Any] = Singleton._instances
    kinds = (GlobalHydra, VersionBase)
    with _lock, shared_store():
        before = {kind: singletons.pop(kind) for kind in kinds if kind in singletons}
        try:
            yield
        finally:
            for kind in kinds:
                singletons.pop(kind, None)
            singletons.update(before)


@contextmanager
def shared_store() -> Iterator[None]:
    """Share one config store between all compositions in the ``with`` block.

    Composing a config never changes the store, and copying the store would take a third of the time.
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
