"""Report an error in a user's plugin in one line that names the plugin and its file; the log holds the traceback."""

import inspect
import logging
import sys
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import CodeType, FrameType, FunctionType

import torch

from brushexp.errors import UserError
from brushexp.registry.plugin import Plugin, loaded_plugins, plugin_of_class
from brushexp.registry.sources import place_of

EXPLAINED_ERRORS = (UserError, MemoryError, torch.OutOfMemoryError)  # errors that get other messages

log = logging.getLogger(__name__)


@contextmanager
def naming_plugins() -> Iterator[None]:
    """Convert an exception or `SystemExit` raised by a user's plugin into a `UserError` that names the plugin."""
    try:
        yield
    except EXPLAINED_ERRORS:
        raise
    except (Exception, SystemExit) as error:
        message = None if isinstance(error.__context__, KeyboardInterrupt) else mistake_of(error)
        if message is None:
            raise
        record = log.makeRecord(log.name, logging.ERROR, __file__, 0, message, (), sys.exc_info())
        for handler in logging.getLogger().handlers:
            if isinstance(handler, logging.FileHandler):
                handler.handle(record)
        raise UserError(message) from error


def mistake_of(error: BaseException) -> str | None:
    """Describe the mistake in a user's plugin that raised ``error``; return None if no such plugin was involved.

    The description names the innermost line of the traceback that lies in a plugin's file. If there is no such line, it
    names the plugin whose object lacks an attribute or has an inherited method that failed.
    """
    users = [(place_of(one.cls), one) for one in loaded_plugins() if not one.is_ours]
    frames = [*traceback.walk_tb(error.__traceback__)]
    for number, (frame, line) in reversed([*enumerate(frames)]):
        file = frame.f_code.co_filename
        owners = [one for source, one in users if source == file]
        if owners:
            what = _in_words(error)
            callers = [other for other, _ in frames[number::-1] if other.f_code.co_filename == file]
            if (owner := _owner_of(callers, owners)) is None:
                return f"plugins in {file}, line {line}: {what}; correct the plugin"
            place = f"{owner.family}={owner.name} ({file}, line {line})"
            return f"{place}: {what}; correct the plugin, or choose another {owner.family}"
    for source, owner in users:
        if isinstance(error, AttributeError) and isinstance(error.obj, owner.cls):
            return f"{owner.family}={owner.name} ({source}): it has no attribute {error.name}; correct the plugin"
    for frame, _ in reversed(frames):
        for source, owner in users:
            if isinstance(frame.f_locals.get("self"), owner.cls):
                return f"{owner.family}={owner.name} ({source}): {_in_words(error)}; correct the plugin"
    return None


def _in_words(error: BaseException) -> str:
    if isinstance(error, SystemExit):
        return f"ends the program (exit code {error.code})"
    return f"{type(error).__name__}: {str(error).strip().partition(chr(10))[0]}"


def name_member(family: str, member: object, name: str = "") -> str:
    """Return a family member's name for messages, such as ``loss=mse``, followed by the file of a user's plugin."""
    plugin = plugin_of_class(type(member))
    is_ours = plugin is None or plugin.is_ours
    source = "" if is_ours else f" ({place_of(type(member))})"
    return f"{family}={name or (plugin.name if plugin else type(member).__name__)}{source}"


def _owner_of(frames: Sequence[FrameType], owners: Sequence[Plugin]) -> Plugin | None:
    """Find which of several plugins in one file a call belongs to; ``frames`` lists the innermost frame first.

    A method belongs to the class of its ``self`` or the class that defines it. A function outside the classes, such as
    a hook for Lightning, belongs to the plugin whose methods mention it, if there is only one.
    """
    if len(owners) == 1:
        return owners[0]
    for frame in frames:
        for owner in owners:
            is_inside = frame.f_code.co_qualname.startswith(f"{owner.cls.__qualname__}.")
            if is_inside or isinstance(frame.f_locals.get("self"), owner.cls):
                return owner
    for frame in frames:
        name = frame.f_code.co_qualname.partition(".")[0]
        if len(naming := [owner for owner in owners if name in _names_in(owner.cls)]) == 1:
            return naming[0]
    return None


def _names_in(cls: type) -> set[str]:
    """Return the names used in the methods of a class."""
    methods = [inspect.unwrap(value) for value in vars(cls).values() if isinstance(value, FunctionType)]
    codes, names = [method.__code__ for method in methods], set[str]()
    while codes:
        code = codes.pop()
        names.update(code.co_names)
        codes += [constant for constant in code.co_consts if isinstance(constant, CodeType)]
    return names
