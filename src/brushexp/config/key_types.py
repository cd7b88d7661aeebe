"""Look up the types of keys and plugin options by name, importing as few plugins as possible."""

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
    """Check whether a name is a task's key, a plugin's option, or a config group."""
    return name in CHOSEN_GROUPS or type_of_key(name)[0] is not None


@cache
def type_of_key(name: str, task: str = "") -> tuple[Any, bool]:
    """Return the type of a key and whether it may be null, or (None, False) if no such key exists.

    The keys of ``task`` take precedence, because a key's type may differ between tasks. If an option's type differs
    between the plugins of a family, the result is ``str`` if that is one of the types, and otherwise ``object``.

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
    """Return the type that remains when null is removed from an optional type."""
    parts = get_args(annotation)
    return next(part for part in parts if part is not NoneType) if NoneType in parts else annotation


def _annotations_of(name: str, task: str) -> Iterator[list[Any]]:
    """Yield lists of the annotations found for a name: in the task, then in plugins or in any other task.

    A short word for an option of a change has the type of that option.
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
    """List the plugins that may have an option, each with the plugin's own name for it."""
    if family in MULTI_SELECT:
        name, _, own = option.partition(".")
        plugin = member(family, name)
        return [] if plugin is None else [(plugin, own)]
    return [(plugin, option) for plugin in plugins(family)]
