"""Declare the values that an option takes: ``width: Annotated[int, at_least(1)] = 64``."""

import difflib
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, get_args

from brushexp.errors import UserError

LARGEST = 1e9  # what any number may be, unless its limits say otherwise: no sum of such numbers overflows 32 bits


@dataclass(frozen=True)
class Bounds:
    """Limits of a number, or the only values that it or a text may have.

    >>> between(0, 1).check("blend.opaque", 1.5)
    Traceback (most recent call last):
    ...
    brushexp.errors.UserError: blend.opaque=1.5 is not 0 to 1; try blend.opaque=1
    """

    low: float = -LARGEST
    high: float = LARGEST
    above: bool = False  # whether ``low`` itself is too small
    step: int = 1  # whole numbers only in multiples of this
    names: tuple[str | int, ...] = ()  # the only values; empty if any number between will do

    def __str__(self) -> str:
        if self.names:
            return f"one of {', '.join(map(str, self.names))}"
        if self.above:
            limits = f"above {_plain(self.low)}" + (f" and at most {_plain(self.high)}" if self.high < LARGEST else "")
        elif self.high != LARGEST:
            limits = f"{_plain(self.low)} to {_plain(self.high)}"
        else:
            limits = f"at least {_plain(self.low)}" if self.low > -LARGEST else f"a number up to {_plain(LARGEST)}"
        return f"a multiple of {self.step}, {limits}" if self.step > 1 else limits

    def check(self, option: str, value: Any, default: Any = None) -> None:
        """Refuse a value beyond the bounds; None has none, and of a list or mapping every element counts.

        The UserError names the nearest value that would do, or the default where there is none.
        """
        if isinstance(value, dict | list | tuple):
            for element in value.values() if isinstance(value, dict) else value:
                if isinstance(value, list) and (element is None or isinstance(element, dict | list)):
                    raise UserError(f"{option} holds {element}; give plain values, '{option}=[...]'")
                self.check(option, element)
        elif value is not None and not self._holds(value):
            limits = f"at most {_plain(LARGEST)}" if _is_number(value) and value > self.high == LARGEST else self
            raise UserError(f"{option}={_plain(value)} is not {limits}; try {option}={self._nearest(value, default)}")

    def _holds(self, value: Any) -> bool:
        if self.names:
            return value in self.names
        if not _is_number(value):
            return True  # types are checked when a config is composed
        inside = self.low < value <= self.high if self.above else self.low <= value <= self.high
        return inside and (self.step == 1 or value % self.step == 0)

    def _nearest(self, value: Any, default: Any) -> Any:
        if self.names:
            if isinstance(value, int | float):
                return min(self.names, key=lambda name: abs(float(name) - value))
            return (difflib.get_close_matches(str(value), map(str, self.names), 1) or self.names)[0]
        if (self.above and value <= self.low) or not abs(value) <= LARGEST:
            fallback = self.high if self.high < LARGEST else max(self.low, 0) + 1
            return _plain(default if _is_number(default) else fallback)
        nearest = min(max(value, self.low), self.high)
        return _plain(max(nearest // self.step, 1) * self.step if self.step > 1 else nearest)


ANY = Bounds()  # for options without limits of their own


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _plain(value: Any) -> str:
    return f"{value:.12g}" if isinstance(value, float) else str(value)


def at_least(low: float) -> Bounds:
    """Bound a number from below, by ``low``."""
    return Bounds(low)


def above(low: float, high: float = LARGEST) -> Bounds:
    """More than ``low``, at most ``high``."""
    return Bounds(low, high, above=True)


def between(low: float, high: float) -> Bounds:
    """Bound a number from ``low`` to ``high``, both included."""
    return Bounds(low, high)


def multiple_of(step: int, high: float = LARGEST) -> Bounds:
    """``step``, twice ``step``, ... up to ``high``."""
    return Bounds(step, high, step=step)


def one_of(*names: str | int) -> Bounds:
    """Bound a value to these names or whole numbers."""
    return Bounds(names=names)


@dataclass(frozen=True)
class Rule:
    """Require that what reads a text later, or each element of a list, can read it."""

    read: Callable[[str, str], object]  # from value and option; a UserError if it is not that
    besides: tuple[str, ...] = ()  # values that are not read

    def check(self, option: str, value: Any, default: Any = None) -> None:
        """Check a value as `Bounds.check` does."""
        for one in value if isinstance(value, list | tuple) else [value]:
            if isinstance(one, dict | list):
                raise UserError(f"{option} holds {one}; give plain values, '{option}=[...]'")
            if one is not None and one not in self.besides:
                self.read(one, option)


def _check_duration(value: str, option: str) -> None:
    if not re.fullmatch(r"\d+:\d\d:\d\d:\d\d", value):
        raise UserError(f"{option}={value} is no days:hours:minutes:seconds; for ten minutes: {option}=00:00:10:00")


def path_rule(exists: Callable[[str], bool], cure: str) -> Rule:
    """Require a path that ``exists``; the UserError ends in ``cure``."""

    def read(path: str, option: str) -> None:
        if not exists(path):
            raise UserError(f"{option}={path}: there is no {cure.format(option=option)}")

    return Rule(read)


def _check_interrupted(folder: str, option: str) -> None:
    """Require the folder of a run that can go on; the UserError says what it is instead."""
    if not os.path.isdir(folder):
        raise UserError(f"{option}={folder}: there is no such folder; give the folder of an interrupted run")
    has = {name for name in ("checkpoint.ckpt", "multirun.yaml", "metrics.json") if os.path.isfile(f"{folder}/{name}")}
    if "checkpoint.ckpt" in has:
        return
    if "multirun.yaml" in has:
        raise UserError(f"{option}={folder}: this is a sweep; type it again as it was, and add resume=sweep")
    if "metrics.json" in has:
        raise UserError(f"{option}={folder}: this run has ended, and nothing is left to go on with")
    raise UserError(f"{option}={folder}: there is no checkpoint.ckpt; give the folder of an interrupted run")


DURATION = Rule(_check_duration)
FOLDER = path_rule(os.path.isdir, "such folder; give the folder of a run or of a sweep")
INTERRUPTED_RUN = Rule(_check_interrupted)
FILE = path_rule(os.path.isfile, "such file; correct the path, or set {option}=null")


def bounds_of(annotation: Any) -> Bounds | Rule | None:
    """The bounds inside a type, ``Annotated[float, between(0, 1)] | None`` for instance."""
    bounds = (part if isinstance(part, Bounds | Rule) else bounds_of(part) for part in get_args(annotation))
    return next((part for part in bounds if part is not None), None)
