"""Mistakes in users' plugins, told in one line with family, name and file; the traceback is in the run's log."""

import inspect
import logging
import math
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import wraps
from numbers import Real
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import torch
from torch import Tensor

from brushexp.errors import UserError
from brushexp.strokes.catalogue import check_strokes

OURS = "brushexp."  # first letters of the modules that come with the program
SAID_ALREADY = (UserError, MemoryError, torch.OutOfMemoryError)  # errors that are told in other words

log = logging.getLogger(__name__)


def is_real(value: Any, shape: tuple[int, ...]) -> bool:
    """Whether it is a tensor of this shape, of numbers that are neither whole nor complex."""
    return isinstance(value, Tensor) and value.shape == shape and value.dtype.is_floating_point


def is_window(found: Any, parameters: Tensor) -> bool:
    """Whether a network or an engine has drawn strokes (n, 10)."""
    images = found if isinstance(found, Tensor) else found.images
    return is_real(images, (len(parameters), 4, *2 * images.shape[-1:])) and bool(images.isfinite().all())


def is_update(found: Any, state: Any) -> bool:
    """Whether it says which strokes stay, and all of those that it adds are valid."""
    check_strokes(found.new)
    return found.keep.shape == state.strokes.width.shape and found.keep.dtype == torch.bool


def are_strokes(found: Any, target: Tensor, n: int, *_: object) -> bool:
    """Whether they are as many as asked, all of them valid."""
    check_strokes(found)
    return len(found) == n


def is_view(found: Any, strokes: Any, size: tuple[int, int], *_: object) -> bool:
    """Whether a step can look at it."""
    region = found.region
    bottom, right = region.top + region.height, region.left + region.width
    return 0 <= region.top < bottom <= size[0] and 0 <= region.left < right <= size[1]


def is_callback(found: Any, folder: object) -> bool:
    """Whether Lightning takes it."""
    from lightning import Callback  # noqa: PLC0415  (takes seconds; --help should not)

    return isinstance(found, Callback)


RULES: dict[tuple[str, str], tuple[str, Callable[..., bool]]] = {  # beside the types that the contracts state
    ("init", "__call__"): ("exactly n valid strokes", are_strokes),
    ("renderer", "draw"): ("finite pictures (n, 4, S, S)", is_window),
    ("engine", "__call__"): ("finite pictures (n, 4, S, S)", lambda found, rows, **_: is_window(found, rows)),
    ("blend", "__call__"): ("a picture (3, H, W)", lambda found, _, __, size, *___: is_real(found.image, (3, *size))),
    ("order", "depth"): (
        "real numbers (N,)",
        lambda found, strokes, *_: found.shape == strokes.width.shape and not found.is_complex(),
    ),
    ("loss", "forward"): ("one real number, of shape ()", lambda found, *_: is_real(found, ())),
    ("density", "revise"): (
        "keep (N,) of bool and valid strokes",
        lambda found, state: found is None or is_update(found, state),
    ),
    ("sampler", "__call__"): ("a region inside the canvas", is_view),
    ("optimizer", "share"): ("a finite number", lambda found, _: math.isfinite(found)),
    ("color", "encode"): (
        "channels (..., C)",
        lambda found, color: is_real(found, (*color.shape[:-1], *found.shape[-1:])),
    ),
    ("color", "decode"): ("a picture (3, H, W)", lambda found, picture: is_real(found, (3, *picture.shape[1:]))),
    ("callbacks", "open"): ("a callback of Lightning", is_callback),
    ("to", "write"): ("paths of files that it has written", lambda found, *_: all(path.is_file() for path in found)),
}


def check_results(family: str, name: str, cls: type, contract: str) -> None:
    """Let the methods of a user's class say so when they return what its contract (a module) does not allow.

    A UserError if the class is none of that contract, or lacks a part of it.
    """
    bases = [base for base in cls.__mro__ if base.__module__ == contract]
    source = inspect.getsourcefile(cls)
    if not bases or inspect.isabstract(cls):
        missing = ", ".join(sorted(getattr(cls, "__abstractmethods__", ()))) or f"a base class of {contract}"
        raise UserError(f"{family}={name} ({source}): class {cls.__name__} lacks {missing}")
    for base in (base for base in cls.__mro__ if not base.__module__.startswith((OURS, "torch", "builtins", "abc"))):
        for method, function in list(vars(base).items()):
            owner = next((part for part in bases if method in vars(part)), None)
            if owner is not None and inspect.isfunction(function) and method != "__init__":
                kind = _return_type(vars(owner)[method])
                words, rule = RULES.get((family, method), (getattr(kind, "__name__", str(kind)), None))
                setattr(base, method, _checked(function, kind, words, rule, f"{family}={name} ({source})"))


def _checked(function: Callable[..., Any], kind: Any, words: Any, rule: Callable[..., bool] | None, who: str) -> Any:
    """The same method, which refuses a result that is not of a ``kind`` or against a ``rule``."""

    @wraps(function)
    def checked(self: Any, *args: Any, **options: Any) -> Any:
        found = function(self, *args, **options)
        try:
            fits = _is_of(found, kind) and (rule is None or rule(found, *args, **options))
        except UserError as error:
            raise UserError(f"{who}: {function.__name__} returns strokes: {error}; correct the plugin") from error
        if not fits:
            shape = f" {tuple(found.shape)} of {found.dtype}" if isinstance(found, Tensor) else ""
            told = repr(found) if isinstance(found, str | Real | None) else type(found).__name__ + shape
            raise UserError(f"{who}: {function.__name__} returns {told}, not {words}; correct the plugin")
        return found

    return checked


def _return_type(function: Any) -> Any:
    """What a method is declared to return; anything where that is not known before Lightning is imported."""
    try:
        return get_type_hints(function).get("return", Any)
    except NameError:
        return Any


def _is_of(value: Any, kind: Any) -> bool:
    origin, parts = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        return any(_is_of(value, part) for part in parts)
    if kind is float:
        return isinstance(value, Real)
    if origin is list:
        return isinstance(value, list) and all(_is_of(element, parts[0]) for element in value)
    return kind is Any or isinstance(value, NoneType if kind is None else origin or kind)


@contextmanager
def plugins_named(plugins: Iterable[Any]) -> Iterator[None]:
    """Tell of an exception in a file of a user's plugin, a `SystemExit` too, as a `UserError` that names them."""
    try:
        yield
    except SAID_ALREADY:
        raise
    except (Exception, SystemExit) as error:
        told = None if isinstance(error.__context__, KeyboardInterrupt) else mistake_of(error, plugins)
        if told is None:
            raise
        record = log.makeRecord(log.name, logging.ERROR, __file__, 0, told, (), sys.exc_info())
        for handler in logging.getLogger().handlers:
            if isinstance(handler, logging.FileHandler):
                handler.handle(record)
        raise UserError(told) from error


def mistake_of(error: BaseException, plugins: Iterable[Any]) -> str | None:
    """What is wrong in the innermost line of a user's plugin that an error came through; None if it did not."""
    users = [(inspect.getsourcefile(one.cls), one) for one in plugins if not one.cls.__module__.startswith(OURS)]
    for frame, line in reversed(list(traceback.walk_tb(error.__traceback__))):
        owners = [one for file, one in users if file == frame.f_code.co_filename]
        if owners:
            owner = next((one for one in owners if isinstance(frame.f_locals.get("self"), one.cls)), owners[0])
            what = f"{type(error).__name__}: {str(error).strip().partition(chr(10))[0]}"
            what = f"ends the program (exit code {error.code})" if isinstance(error, SystemExit) else what
            place = f"{owner.family}={owner.name} ({frame.f_code.co_filename}, line {line})"
            return f"{place}: {what}; correct the plugin, or choose another {owner.family}"
    return None
