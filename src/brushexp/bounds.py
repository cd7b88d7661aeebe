"""Declare the allowed values of an option: ``width: Annotated[int, at_least(1)] = 64``."""

import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, get_args

from brushexp.errors import UserError, similar_words

PERCENT = 10, 100  # values of a fraction from 0 to 1 that are probably meant as a percentage
LARGEST = 1e9  # the default limit of any number: sums of such numbers do not overflow 32 bits


@dataclass(frozen=True)
class Bounds:
    """Limits of a number, or the list of values that a number or string may take.

    >>> between(0, 1).check("blend.opaque", 1.5)
    Traceback (most recent call last):
    ...
    brushexp.errors.UserError: blend.opaque=1.5 is not 0 to 1; try blend.opaque=1
    """

    low: float = -LARGEST
    high: float = LARGEST
    above: bool = False  # whether ``low`` itself is excluded
    step: int = 1  # whole numbers must be multiples of this
    names: tuple[str | int, ...] = ()  # the allowed values; empty if any number between the limits is allowed
    typical: float | None = None  # a value that messages propose if the default is null or means "off"

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
        """Raise a UserError for a value outside the bounds; None is always accepted.

        Lists and mappings are checked element by element. The error message proposes a value: the upper limit to
        larger values, otherwise a typical value or the default, or else the nearest allowed value.
        """
        if isinstance(value, dict | list | tuple):
            for element in value.values() if isinstance(value, dict) else value:
                if isinstance(value, list) and (element is None or isinstance(element, dict | list)):
                    raise UserError(f"{option} holds {element}; give plain values, '{option}=[...]'")
                self.check(option, element)
        elif value is not None and not self._holds(value):
            limits = f"at most {_plain(LARGEST)}" if _is_number(value) and value > self.high == LARGEST else self
            raise UserError(f"{option}={_plain(value)} is not {limits}; try {option}={self._proposal(value, default)}")

    def _holds(self, value: Any) -> bool:
        if self.names:
            return value in self.names
        if not _is_number(value):
            return True  # types are checked when a config is composed
        inside = self.low < value <= self.high if self.above else self.low <= value <= self.high
        return inside and (self.step == 1 or value % self.step == 0)

    def example(self, default: Any = None) -> Any:
        """Return the typical value or, if none is declared, the default."""
        return default if self.typical is None else self.typical

    def _proposal(self, value: Any, default: Any) -> Any:
        if self.names:
            if isinstance(value, int | float):
                return min(self.names, key=lambda name: abs(float(name) - value))
            usual = default if default in self.names else self.names[0]
            return (similar_words(str(value), map(str, self.names)) or [str(usual)])[0]
        if self.high == 1 and PERCENT[0] <= value <= PERCENT[1]:
            return _plain(value / 100)
        if self.step > 1 or self.high < value <= LARGEST or (value > LARGEST and self.high < LARGEST):
            nearest = min(max(value, self.low), self.high)
            return _plain(max(nearest // self.step, 1) * self.step if self.step > 1 else nearest)
        usual = self.example(default)
        if _is_number(usual) and self._holds(usual):
            return _plain(usual)
        fallback = self.high if self.high < LARGEST else max(self.low, 0) + 1
        return _plain(fallback if self.above or not value < self.low else self.low)


ANY = Bounds()  # limits of options that declare none


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _plain(value: Any) -> str:
    return f"{value:.12g}" if isinstance(value, float) else str(value)


def at_least(low: float, *, typical: float | None = None) -> Bounds:
    """Require a number of at least ``low``; error messages propose the ``typical`` value."""
    return Bounds(low, typical=typical)


def above(low: float, high: float = LARGEST, *, typical: float | None = None) -> Bounds:
    """Require a number greater than ``low`` and at most ``high``."""
    return Bounds(low, high, above=True, typical=typical)


def between(low: float, high: float, *, typical: float | None = None) -> Bounds:
    """Require a number from ``low`` to ``high``, inclusive."""
    return Bounds(low, high, typical=typical)


def multiple_of(step: int, high: float = LARGEST) -> Bounds:
    """Require a positive multiple of ``step`` that is at most ``high``."""
    return Bounds(step, high, step=step)


def one_of(*names: str | int) -> Bounds:
    """Require one of the given names or integers."""
    return Bounds(names=names)


@dataclass(frozen=True)
class Rule:
    """Requirement that a string, or each string in a list, can be parsed by the code that will use it."""

    read: Callable[[str, str], object]  # raises a UserError for a value and option that it cannot read
    besides: tuple[str, ...] = ()  # values that are not checked

    def check(self, option: str, value: Any, default: Any = None) -> None:
        """Check a value as `Bounds.check` does."""
        for one in value if isinstance(value, list | tuple) else [value]:
            if isinstance(one, dict | list):
                raise UserError(f"{option} holds {one}; give plain values, '{option}=[...]'")
            if one is not None and one not in self.besides:
                self.read(one, option)


def _check_duration(value: str, option: str) -> None:
    if not re.fullmatch(r"\d+:\d\d:\d\d:\d\d", value):
        raise UserError(f"{option}={value} is not days:hours:minutes:seconds; ten minutes are {option}=00:00:10:00")


def path_rule(exists: Callable[[str], bool], cure: str) -> Rule:
    """Return a rule that accepts a path if ``exists`` is true for it; its UserError otherwise ends with ``cure``."""

    def read(path: str, option: str) -> None:
        if not exists(path):
            raise UserError(f"{option}={path}: there is no {cure.format(option=option)}")

    return Rule(read)


def _check_interrupted(folder: str, option: str) -> None:
    """Raise a UserError that describes the folder unless it is the folder of a run that can be resumed."""
    if not os.path.isdir(folder):
        raise UserError(f"{option}={folder}: there is no such folder; give the folder of an interrupted run")
    has = {name for name in ("checkpoint.ckpt", "multirun.yaml", "metrics.json") if os.path.isfile(f"{folder}/{name}")}
    if "checkpoint.ckpt" in has:
        return
    if "multirun.yaml" in has:
        raise UserError(f"{option}={folder}: this is a sweep; repeat its command and add resume=sweep")
    if "metrics.json" in has:
        raise UserError(f"{option}={folder}: this run is finished, and nothing is left to continue")
    raise UserError(f"{option}={folder}: there is no checkpoint.ckpt; give the folder of an interrupted run")


DURATION = Rule(_check_duration)
FOLDER = path_rule(os.path.isdir, "such folder; give the folder of a run or of a sweep")
INTERRUPTED_RUN = Rule(_check_interrupted)
FILE = path_rule(os.path.isfile, "such file; correct the path, or set {option}=null")


def bounds_of(annotation: Any) -> Bounds | Rule | None:
    """Return the bounds in a type such as ``Annotated[float, between(0, 1)] | None``, or None if it has none."""
    bounds = (part if isinstance(part, Bounds | Rule) else bounds_of(part) for part in get_args(annotation))
    return next((part for part in bounds if part is not None), None)
