"""Report mistakes in users' plugins in one line with family, name and file; the run's log has the traceback."""

import inspect
import logging
import sys
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType

import torch

from brushexp.errors import UserError
from brushexp.registry.plugin import Plugin, loaded_plugins

EXPLAINED_ERRORS = (UserError, MemoryError, torch.OutOfMemoryError)  # errors that are told in other words

log = logging.getLogger(__name__)


@contextmanager
def naming_plugins() -> Iterator[None]:
    """Turn an exception, or a `SystemExit`, in a file of a user's plugin into a `UserError` that names the plugin."""
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
    """Describe the innermost line of a user's plugin that an error came through; None if it came through none."""
    users = [(inspect.getsourcefile(one.cls), one) for one in loaded_plugins() if not one.is_ours]
    frames = [*traceback.walk_tb(error.__traceback__)]
    for number, (frame, line) in reversed([*enumerate(frames)]):
        file = frame.f_code.co_filename
        owners = [one for source, one in users if source == file]
        if owners:
            what = f"{type(error).__name__}: {str(error).strip().partition(chr(10))[0]}"
            what = f"ends the program (exit code {error.code})" if isinstance(error, SystemExit) else what
            callers = [other for other, _ in frames[number::-1] if other.f_code.co_filename == file]
            if (owner := _owner_of(callers, owners)) is None:
                return f"plugins of {file}, line {line}: {what}; correct the plugin"
            place = f"{owner.family}={owner.name} ({file}, line {line})"
            return f"{place}: {what}; correct the plugin, or choose another {owner.family}"
    for source, owner in users:
        if isinstance(error, AttributeError) and isinstance(error.obj, owner.cls):
            return f"{owner.family}={owner.name} ({source}): it has no attribute {error.name}; correct the plugin"
    return None


def _owner_of(frames: Sequence[FrameType], owners: Sequence[Plugin]) -> Plugin | None:
    """Find which of several plugins in one file a call belongs to, from the innermost of its frames outwards.

    A function belongs to the class of its ``self``, or to that within which it is written: a hook of a callback, say.
    """
    if len(owners) == 1:
        return owners[0]
    for frame in frames:
        for owner in owners:
            is_inside = frame.f_code.co_qualname.startswith(f"{owner.cls.__qualname__}.")
            if is_inside or isinstance(frame.f_locals.get("self"), owner.cls):
                return owner
    return None
