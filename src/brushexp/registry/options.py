"""Find a plugin's options: keyword-only parameters of ``__init__`` and attributes that its base class declares."""

import inspect
from copy import copy
from dataclasses import field, make_dataclass
from functools import partial, reduce
from operator import or_
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from omegaconf import MISSING


def options_of(cls: type) -> list[tuple[str, Any, Any]]:
    """Return the name, type and default of each option of a class; the default may be ``MISSING``."""
    tunable = getattr(cls, "tunable", {})
    options = [(name, kind, getattr(cls, name)) for name, kind in tunable.items()]
    for parameter in inspect.signature(cls, eval_str=True).parameters.values():
        if parameter.kind is not parameter.KEYWORD_ONLY:
            continue
        if parameter.annotation is parameter.empty:
            raise TypeError(f"{cls.__qualname__}.__init__: give '{parameter.name}' a type; it is a config key")
        if parameter.name in tunable:
            raise TypeError(f"{cls.__qualname__}: write '{parameter.name} = ...' in the class, not in __init__")
        default = MISSING if parameter.default is parameter.empty else parameter.default
        options.append((parameter.name, parameter.annotation, default))
    return options


def structured_config(cls: type, target: str) -> type:
    """Create a dataclass for OmegaConf with ``_target_`` and, for each option, a typed field without bounds."""
    options = [
        (name, plain_type(kind), field(default_factory=partial(copy, value))) for name, kind, value in options_of(cls)
    ]
    return make_dataclass(f"{cls.__name__}Config", [("_target_", str, target), *options])


def plain_type(annotation: Any) -> Any:
    """Return a type with ``Annotated`` removed from it and from its parameters."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return plain_type(parts[0])
    if origin in (UnionType, Union):
        return reduce(or_, map(plain_type, parts))
    if origin is None or Ellipsis in parts:
        return annotation
    return origin[tuple(map(plain_type, parts))]
