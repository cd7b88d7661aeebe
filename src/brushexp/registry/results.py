"""Check the results of users' plugins against the contracts of their families; errors name the plugin."""

import inspect
import math
from collections.abc import Callable, Sequence
from functools import wraps
from numbers import Real
from types import NoneType, UnionType
from typing import Any, ClassVar, Union, get_args, get_origin, get_type_hints

import torch
from torch import Tensor

from brushexp.errors import UserError
from brushexp.registry.families import CORE
from brushexp.registry.sources import place_of
from brushexp.strokes.catalogue import check_strokes


def _describe(value: Any) -> str:
    """Describe a result by its value if that is short, otherwise by its type and, for a tensor, its shape."""
    if isinstance(value, Tensor):
        return f"{type(value).__name__} {tuple(value.shape)} of {value.dtype}"
    return repr(value) if isinstance(value, str | Real | None) else type(value).__name__


def _is_real(value: Any, shape: tuple[int, ...]) -> bool:
    """Return whether a value is a tensor of floats with this shape."""
    return isinstance(value, Tensor) and value.shape == shape and value.dtype.is_floating_point


def _problem_of_picture(result: Any, picture: Tensor, **_: Any) -> str:
    if not _is_real(result, picture.shape):
        return f"{_describe(result)}, not a picture {tuple(picture.shape)}"
    if not result.isfinite().all():
        return "a picture with non-finite numbers"
    low, high = float(result.min()), float(result.max())
    return "" if low >= 0 and high <= 1 else f"a picture from {low:g} to {high:g}, not in [0, 1]"


def _problem_of_heights(result: Any, rows: Any, **_: Any) -> str:
    if not _is_real(result, (rows.count, rows.size[1])):
        return f"{_describe(result)}, not heights {(rows.count, rows.size[1])}"
    return "" if bool((result >= 0).all()) else "heights that are not all 0 or more"


def _problem_of_window(result: Any, parameters: Tensor, **_: Any) -> str:
    images = result if isinstance(result, Tensor) else getattr(result, "images", None)
    if not isinstance(images, Tensor) or not _is_real(images, (len(parameters), 4, *2 * images.shape[-1:])):
        return f"{_describe(images)}, not pictures ({len(parameters)}, 4, S, S)"
    return "" if bool(images.isfinite().all()) else "pictures with non-finite numbers"


def _problem_of_update(result: Any, state: Any, **_: Any) -> str:
    if result is None:
        return ""
    check_strokes(result.new)
    is_mask = result.keep.shape == state.strokes.width.shape and result.keep.dtype == torch.bool
    return "" if is_mask else f"keep as {_describe(result.keep)}, not {tuple(state.strokes.width.shape)} of bool"


def _problem_of_strokes(result: Any, target: Tensor, n: int, *_: object, **__: object) -> str:
    check_strokes(result)
    return "" if len(result) == n else f"{len(result)} strokes, not {n}"


def _problem_of_view(result: Any, strokes: Any, size: tuple[int, int], *_: object, **__: object) -> str:
    region = result.region
    bottom, right = region.top + region.height, region.left + region.width
    if 0 <= region.top < bottom <= size[0] and 0 <= region.left < right <= size[1]:
        return ""
    return f"{region}, which is not inside the canvas of {size[0]} x {size[1]} pixels"


def _problem_of_callback(result: Any, *_: object, **__: object) -> str:
    from lightning import Callback  # noqa: PLC0415  (takes seconds; --help should not)

    return "" if isinstance(result, Callback) else f"{_describe(result)}, not a callback of Lightning"


def _problem_of_files(result: Any, *_: object, **__: object) -> str:
    missing = [str(path) for path in result if not path.is_file()]
    return f"{', '.join(missing)}, which it did not write" if missing else ""


def _problem_of_number(result: Any, strokes: Any, *_: object, **__: object) -> str:
    return "" if len(result) == len(strokes) else f"{len(result)} strokes, not {len(strokes)}"


def _problem_of_first_strokes(result: Any, strokes: Any, *_: object, **__: object) -> str:
    check_strokes(result)
    return _problem_of_number(result, strokes)


def _problem_of_aim(result: Any, target: Tensor, ground: Tensor, *_: object, **__: object) -> str:
    picture, color = result
    if not _is_real(picture, target.shape):
        return f"{_describe(picture)}, not a target {tuple(target.shape)}"
    return "" if _is_real(color, ground.shape) else f"{_describe(color)}, not a ground {tuple(ground.shape)}"


def _problem_of_end(result: Any, strokes: Any, *_: object, **__: object) -> str:
    finished, order = result
    check_strokes(finished)
    if len(finished) < len(strokes):
        return f"{len(finished)} strokes, fewer than the {len(strokes)} before"
    is_order = order.ndim == 1 and torch.equal(order.sort().values, torch.arange(len(finished), device=order.device))
    return "" if is_order else f"{_describe(order)}, not the numbers of all {len(finished)} strokes in their order"


def _make_shape_check(shape: Callable[..., tuple[int, ...]], what: str) -> Callable[..., str]:
    """Create a check for a float tensor whose shape depends on the arguments; ``what`` describes the tensor."""

    def problem(result: Any, *args: Any, **_: Any) -> str:
        wanted = shape(result, *args)
        return "" if _is_real(result, wanted) else f"{_describe(result)}, not {what} {wanted}"

    return problem


def _problem_of_canvas(
    result: Any,
    _: Any,
    __: Any,
    size: tuple[int, int],
    background: Tensor,
    *___: object,
    **____: object,
) -> str:
    wanted = (*background.shape, *size)
    return "" if _is_real(result.image, wanted) else f"{_describe(result.image)}, not a picture {wanted}"


def _problem_of_depth(result: Tensor, strokes: Any, *_: object, **__: object) -> str:
    fits = result.shape == strokes.width.shape and not result.is_complex()
    return "" if fits else f"{_describe(result)}, not real numbers {tuple(strokes.width.shape)}"


def _problem_of_encoding(result: Any, color: Tensor, **_: object) -> str:
    fits = isinstance(result, Tensor) and _is_real(result, (*color.shape[:-1], *result.shape[-1:]))
    return "" if fits else f"{_describe(result)}, not channels {(*color.shape[:-1], 'C')}"


PROBLEMS: dict[tuple[str, str], Callable[..., str]] = {  # functions that return what is wrong with a result, or ""
    ("palette", "__call__"): _problem_of_picture,
    ("paper", "cover"): _make_shape_check(lambda result, flat, *_: flat.shape, "a picture"),
    ("paper", "relief"): _problem_of_heights,
    ("init", "__call__"): _problem_of_strokes,
    ("renderer", "draw"): _problem_of_window,
    ("engine", "__call__"): _problem_of_window,
    ("blend", "__call__"): _problem_of_canvas,
    ("order", "depth"): _problem_of_depth,
    ("loss", "forward"): _make_shape_check(lambda *_: (), "one real number, of shape"),
    ("density", "revise"): _problem_of_update,
    ("sampler", "__call__"): _problem_of_view,
    ("optimizer", "share"): lambda result, *_, **__: "" if math.isfinite(result) else f"{result}, not a finite number",
    ("color", "encode"): _problem_of_encoding,
    ("color", "decode"): _make_shape_check(lambda result, picture: (3, *picture.shape[1:]), "a picture"),
    ("change", "target"): _problem_of_picture,
    ("change", "ground"): _make_shape_check(lambda result, color: color.shape, "a colour"),
    ("change", "begin"): _problem_of_first_strokes,
    ("change", "aim"): _problem_of_aim,
    ("change", "limit"): _problem_of_number,
    ("change", "end"): _problem_of_end,
    ("callbacks", "open"): _problem_of_callback,
    ("to", "write"): _problem_of_files,
}


def check_results(family: str, name: str, cls: type, contract: str) -> None:
    """Make the methods of a user's class check their results against the declarations in the module ``contract``.

    Raises a UserError if the class lacks a method or attribute, or if a method does not accept its arguments.
    """
    bases = [base for base in cls.__mro__ if base.__module__ == contract]
    source = place_of(cls)
    notes = {name: kind for base in bases for name, kind in vars(base).get("__annotations__", {}).items()}
    unset = [name for name, kind in notes.items() if get_origin(kind) is ClassVar and not hasattr(cls, name)]
    if not bases or inspect.isabstract(cls) or unset:
        missing = [*sorted(getattr(cls, "__abstractmethods__", ())), *unset] or [f"a base class of {contract}"]
        raise UserError(f"{family}={name} ({source}): class {cls.__name__} lacks {', '.join(missing)}")
    for base in (base for base in cls.__mro__ if not base.__module__.startswith((CORE, "torch", "builtins", "abc"))):
        for method, function in list(vars(base).items()):
            owner = next((part for part in bases if inspect.isfunction(vars(part).get(method))), None)
            if owner is not None and inspect.isfunction(function) and method != "__init__":
                who = f"{family}={name} ({source})"
                _check_arguments(function, vars(owner)[method], who)
                kind = _return_type(vars(owner)[method])
                setattr(base, method, _wrap_with_check(function, kind, PROBLEMS.get((family, method)), who))


def _check_arguments(function: Callable[..., Any], contract: Callable[..., Any], who: str) -> None:
    """Raise a UserError if a method does not accept the arguments that its contract declares."""
    ours, theirs = (inspect.signature(one).parameters for one in (contract, function))
    positional = [name for name, one in ours.items() if one.kind is one.POSITIONAL_OR_KEYWORD]
    named = {name: None for name, one in ours.items() if one.kind is one.KEYWORD_ONLY}
    try:
        inspect.signature(function).bind(*positional, **named)
    except TypeError as error:
        is_called = f"{function.__name__}({', '.join(theirs)}) is called with ({', '.join(ours)})"
        raise UserError(f"{who}: {is_called}; correct the plugin") from error


def _wrap_with_check(function: Callable[..., Any], kind: Any, problem_of: Callable[..., str] | None, who: str) -> Any:
    """Wrap a method so that it raises a UserError if its result is not a ``kind`` or ``problem_of`` rejects it."""

    @wraps(function)
    def call_and_check(self: Any, *args: Any, **options: Any) -> Any:
        result = function(self, *args, **options)
        try:
            if not _is_of(result, kind):
                problem = f"{_describe(result)}, not {getattr(kind, '__name__', str(kind))}"
            else:
                problem = _problem_of_device(result, args)
                problem = problem or ("" if problem_of is None else problem_of(result, *args, **options))
        except UserError as error:
            raise UserError(f"{who}: {function.__name__} returns wrong strokes: {error}; correct the plugin") from error
        if problem:
            raise UserError(f"{who}: {function.__name__} returns {problem}; correct the plugin")
        return result

    return call_and_check


def _problem_of_device(result: Any, args: Sequence[object]) -> str:
    """Describe the problem if a result is a tensor on a different device from the arguments; otherwise return ""."""
    if not isinstance(result, Tensor):
        return ""
    parts = [part for value in args for part in (value, *getattr(value, "__dict__", {}).values())]
    devices = {part.device for part in parts if isinstance(part, Tensor)}
    places = ", ".join(sorted(map(str, devices)))
    return f"a tensor on {result.device}, not on {places}" if devices and result.device not in devices else ""


def _return_type(function: Any) -> Any:
    """Return a function's declared result type, or `Any` if it cannot be resolved before Lightning is imported."""
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
