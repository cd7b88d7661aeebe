"""Report mistakes in users' plugins in one line with family, name and file; the run's log has the traceback."""

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
from typing import Any, ClassVar, Union, get_args, get_origin, get_type_hints

import torch
from torch import Tensor

from brushexp.errors import UserError
from brushexp.strokes.catalogue import check_strokes

OURS = "brushexp."  # first letters of the modules that come with the program
EXPLAINED_ERRORS = (UserError, MemoryError, torch.OutOfMemoryError)  # errors that are told in other words

log = logging.getLogger(__name__)


def _is_real(value: Any, shape: tuple[int, ...]) -> bool:
    """Whether a value is a tensor of floats of this shape."""
    return isinstance(value, Tensor) and value.shape == shape and value.dtype.is_floating_point


def _is_picture(result: Any, picture: Tensor) -> bool:
    return _is_real(result, picture.shape) and bool(((result >= 0) & (result <= 1)).all())


def _is_window(result: Any, parameters: Tensor) -> bool:
    images = result if isinstance(result, Tensor) else result.images
    return _is_real(images, (len(parameters), 4, *2 * images.shape[-1:])) and bool(images.isfinite().all())


def _is_update(result: Any, state: Any) -> bool:
    check_strokes(result.new)
    return result.keep.shape == state.strokes.width.shape and result.keep.dtype == torch.bool


def _are_strokes(result: Any, target: Tensor, n: int, *_: object) -> bool:
    check_strokes(result)
    return len(result) == n


def _is_view(result: Any, strokes: Any, size: tuple[int, int], *_: object) -> bool:
    region = result.region
    bottom, right = region.top + region.height, region.left + region.width
    return 0 <= region.top < bottom <= size[0] and 0 <= region.left < right <= size[1]


def _is_callback(result: Any, folder: object) -> bool:
    from lightning import Callback  # noqa: PLC0415  (takes seconds; --help should not)

    return isinstance(result, Callback)


def _are_first_strokes(result: Any, strokes: Any, *_: object, **__: object) -> bool:
    check_strokes(result)
    return len(result) == len(strokes)


def _are_as_many(result: Any, strokes: Any, *_: object, **__: object) -> bool:
    return len(result) == len(strokes)


def _is_aim(result: Any, target: Tensor, ground: Tensor, *_: object, **__: object) -> bool:
    picture, color = result
    return _is_real(picture, target.shape) and _is_real(color, ground.shape)


def _is_ended(result: Any, strokes: Any, *_: object, **__: object) -> bool:
    finished, order = result
    check_strokes(finished)
    numbers = torch.arange(len(finished), device=order.device)
    return len(finished) >= len(strokes) and torch.equal(order.sort().values, numbers)


RULES: dict[tuple[str, str], tuple[str, Callable[..., bool]]] = {  # they hold beside the types that contracts state
    ("palette", "__call__"): ("a picture in [0, 1] of the same size", _is_picture),
    ("paper", "cover"): ("a picture of the same size", lambda result, flat, *_: _is_real(result, flat.shape)),
    ("paper", "relief"): (
        "heights (h, W) of 0 or more",
        lambda result, rows: _is_real(result, (rows.count, rows.size[1])) and bool((result >= 0).all()),
    ),
    ("init", "__call__"): ("exactly n valid strokes", _are_strokes),
    ("renderer", "draw"): ("finite pictures (n, 4, S, S)", _is_window),
    ("engine", "__call__"): ("finite pictures (n, 4, S, S)", lambda result, rows, **_: _is_window(result, rows)),
    ("blend", "__call__"): (
        "a picture (C, H, W)",
        lambda result, _, __, size, background, *___: _is_real(result.image, (*background.shape, *size)),
    ),
    ("order", "depth"): (
        "real numbers (N,)",
        lambda result, strokes, *_: result.shape == strokes.width.shape and not result.is_complex(),
    ),
    ("loss", "forward"): ("one real number, of shape ()", lambda result, *_: _is_real(result, ())),
    ("density", "revise"): (
        "keep (N,) of bool and valid strokes",
        lambda result, state: result is None or _is_update(result, state),
    ),
    ("sampler", "__call__"): ("a region inside the canvas", _is_view),
    ("optimizer", "share"): ("a finite number", lambda result, _: math.isfinite(result)),
    ("color", "encode"): (
        "channels (..., C)",
        lambda result, color: _is_real(result, (*color.shape[:-1], *result.shape[-1:])),
    ),
    ("change", "target"): ("a picture in [0, 1] of the same size", _is_picture),
    ("change", "ground"): ("a colour (3,)", lambda result, color: _is_real(result, color.shape)),
    ("change", "begin"): ("as many valid strokes", _are_first_strokes),
    ("change", "aim"): ("a target (3, H, W) and a ground (3,)", _is_aim),
    ("change", "limit"): ("as many strokes", _are_as_many),
    ("change", "end"): ("valid strokes, no fewer, and the numbers of all of them in their order", _is_ended),
    ("color", "decode"): ("a picture (3, H, W)", lambda result, picture: _is_real(result, (3, *picture.shape[1:]))),
    ("callbacks", "open"): ("a callback of Lightning", _is_callback),
    ("to", "write"): ("paths of files that it has written", lambda result, *_: all(path.is_file() for path in result)),
}


def check_results(family: str, name: str, cls: type, contract: str) -> None:
    """Check each result of a user's class against its contract (a module); a UserError if the class lacks a part."""
    bases = [base for base in cls.__mro__ if base.__module__ == contract]
    source = inspect.getsourcefile(cls)
    notes = {name: kind for base in bases for name, kind in vars(base).get("__annotations__", {}).items()}
    unset = [name for name, kind in notes.items() if get_origin(kind) is ClassVar and not hasattr(cls, name)]
    if not bases or inspect.isabstract(cls) or unset:
        missing = [*sorted(getattr(cls, "__abstractmethods__", ())), *unset] or [f"a base class of {contract}"]
        raise UserError(f"{family}={name} ({source}): class {cls.__name__} lacks {', '.join(missing)}")
    for base in (base for base in cls.__mro__ if not base.__module__.startswith((OURS, "torch", "builtins", "abc"))):
        for method, function in list(vars(base).items()):
            owner = next((part for part in bases if inspect.isfunction(vars(part).get(method))), None)
            if owner is not None and inspect.isfunction(function) and method != "__init__":
                _check_arguments(function, vars(owner)[method], f"{family}={name} ({source})")
                kind = _return_type(vars(owner)[method])
                words, rule = RULES.get((family, method), (getattr(kind, "__name__", str(kind)), None))
                setattr(base, method, _checked(function, kind, words, rule, f"{family}={name} ({source})"))


def _check_arguments(function: Callable[..., Any], contract: Callable[..., Any], who: str) -> None:
    """Refuse (UserError) a method that cannot be called with the arguments that its contract names."""
    ours, theirs = (inspect.signature(one).parameters for one in (contract, function))
    positional = [name for name, one in ours.items() if one.kind is one.POSITIONAL_OR_KEYWORD]
    named = {name: None for name, one in ours.items() if one.kind is one.KEYWORD_ONLY}
    try:
        inspect.signature(function).bind(*positional, **named)
    except TypeError as error:
        is_called = f"{function.__name__}({', '.join(theirs)}) is called as ({', '.join(ours)})"
        raise UserError(f"{who}: {is_called}; correct the plugin") from error


def _checked(function: Callable[..., Any], kind: Any, words: Any, rule: Callable[..., bool] | None, who: str) -> Any:
    """Wrap a method so that it refuses a result of another ``kind`` or against a ``rule``."""

    @wraps(function)
    def checked(self: Any, *args: Any, **options: Any) -> Any:
        result = function(self, *args, **options)
        try:
            fits = _is_of(result, kind) and (rule is None or rule(result, *args, **options))
        except UserError as error:
            raise UserError(f"{who}: {function.__name__} returns strokes: {error}; correct the plugin") from error
        if not fits:
            shape = f" {tuple(result.shape)} of {result.dtype}" if isinstance(result, Tensor) else ""
            text = repr(result) if isinstance(result, str | Real | None) else type(result).__name__ + shape
            raise UserError(f"{who}: {function.__name__} returns {text}, not {words}; correct the plugin")
        return result

    return checked


def _return_type(function: Any) -> Any:
    """Return the declared type of a result; `Any` where it is unknown before Lightning is imported."""
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
def naming_plugins(plugins: Iterable[Any]) -> Iterator[None]:
    """Turn an exception, or a `SystemExit`, in a file of a user's plugin into a `UserError` that names the plugin."""
    try:
        yield
    except EXPLAINED_ERRORS:
        raise
    except (Exception, SystemExit) as error:
        message = None if isinstance(error.__context__, KeyboardInterrupt) else mistake_of(error, plugins)
        if message is None:
            raise
        record = log.makeRecord(log.name, logging.ERROR, __file__, 0, message, (), sys.exc_info())
        for handler in logging.getLogger().handlers:
            if isinstance(handler, logging.FileHandler):
                handler.handle(record)
        raise UserError(message) from error


def mistake_of(error: BaseException, plugins: Iterable[Any]) -> str | None:
    """Describe the innermost line of a user's plugin that an error came through; None if it came through none."""
    users = [(inspect.getsourcefile(one.cls), one) for one in plugins if not one.cls.__module__.startswith(OURS)]
    for frame, line in reversed(list(traceback.walk_tb(error.__traceback__))):
        owners = [one for file, one in users if file == frame.f_code.co_filename]
        if owners:
            owner = next((one for one in owners if isinstance(frame.f_locals.get("self"), one.cls)), owners[0])
            what = f"{type(error).__name__}: {str(error).strip().partition(chr(10))[0]}"
            what = f"ends the program (exit code {error.code})" if isinstance(error, SystemExit) else what
            place = f"{owner.family}={owner.name} ({frame.f_code.co_filename}, line {line})"
            return f"{place}: {what}; correct the plugin, or choose another {owner.family}"
    for file, owner in users:
        if isinstance(error, AttributeError) and isinstance(error.obj, owner.cls):
            return f"{owner.family}={owner.name} ({file}): it has no attribute {error.name}; correct the plugin"
    return None
