"""Find the types of keys and of plugin options by name, importing as few plugins as possible."""

from collections.abc import Iterator
from dataclasses import fields
from functools import cache
from types import NoneType
from typing import Any, get_args

from brushexp.config.compose import CHOSEN_GROUPS
from brushexp.config.keys import keys_of
from brushexp.config.tasks import TASKS
from brushexp.config.vocabulary import options_of_word
from brushexp.registry import FAMILIES, MULTI_SELECT, Plugin, member, plugins


def is_key(name: str) -> bool:
    """Check whether a name is a key of a task, an option of a plugin, or a config group."""
    return name in CHOSEN_GROUPS or type_of_key(name)[0] is not None


@cache
def type_of_key(name: str, task: str = "") -> tuple[Any, bool]:
    """Return the type of a key and whether it may be null, or (None, False) if no such key exists.

    Keys of ``task`` come first, because keys of the same name may differ in type between tasks. If the plugins of a
    family give an option different types, the type is ``str`` if any of them is, otherwise ``object``.

    >>> type_of_key("strokes"), type_of_key("strokes", "score"), type_of_key("nothing")
    ((<class 'int'>, True), (<class 'str'>, False), (None, False))
    """
    for annotations in _annotations_of(name, task):
        if annotations:
            types = {without_null(annotation) for annotation in annotations}
            kind = types.pop() if len(types) == 1 else str if str in types else object
            return kind, any(NoneType in get_args(annotation) for annotation in annotations)
    return None, False


def without_null(annotation: Any) -> Any:
    """Return a type without null."""
    parts = get_args(annotation)
    return next(part for part in parts if part is not NoneType) if NoneType in parts else annotation


def _annotations_of(name: str, task: str) -> Iterator[list[Any]]:
    """Yield the annotations of a name in the task, then in plugins, then in all other tasks.

    A word for an option of a change has the type of that option.
    """
    for other in dict.fromkeys([*([task] if task in TASKS else []), "paint"]):
        yield [key.annotation] if (key := keys_of(TASKS[other]).get(name)) is not None else []
    name = next(iter(options_of_word(name)), name)
    family, _, option = name.partition(".")
    if family in FAMILIES and option:
        yield [
            item.type for plugin, own in _owners(family, option) for item in fields(plugin.config) if item.name == own
        ]
    elif family not in CHOSEN_GROUPS:
        yield [key.annotation for other in TASKS if (key := keys_of(TASKS[other]).get(name)) is not None]


def _owners(family: str, option: str) -> list[tuple[Plugin, str]]:
    """List the plugins that may have an option, each with its own name for the option."""
    if family in MULTI_SELECT:
        name, _, own = option.partition(".")
        plugin = member(family, name)
        return [] if plugin is None else [(plugin, own)]
    return [(plugin, option) for plugin in plugins(family)]
