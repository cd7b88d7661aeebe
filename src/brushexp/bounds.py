"""Which values an option takes, said once where it is declared: ``width: Annotated[int, at_least(1)] = 64``."""

import difflib
import math
from dataclasses import dataclass
from typing import Any, get_args

from brushexp.errors import UserError


@dataclass(frozen=True)
class Bounds:
    """Limits of a number, or the only values that it or a text may have.

    >>> between(0, 1).check("blend.opaque", 1.5)
    Traceback (most recent call last):
    ...
    brushexp.errors.UserError: blend.opaque=1.5 is not 0 to 1; try blend.opaque=1
    """

    low: float = -math.inf
    high: float = math.inf
    above: bool = False  # whether ``low`` itself is too small
    step: int = 1  # whole numbers only in multiples of this
    names: tuple[str | int, ...] = ()  # the only values; empty if any number between will do

    def __str__(self) -> str:
        if self.names:
            return f"one of {', '.join(map(str, self.names))}"
        if self.above:
            limits = f"above {self.low:.12g}" + (f" and at most {self.high:.12g}" if self.high < math.inf else "")
        elif self.high < math.inf:
            limits = f"{self.low:.12g} to {self.high:.12g}"
        else:
            limits = f"at least {self.low:.12g}"
        return f"a multiple of {self.step}, {limits}" if self.step > 1 else limits

    def check(self, option: str, value: Any, default: Any = None) -> None:
        """Refuse a value beyond the bounds; None has none, and of a list or mapping every element counts.

        Raises:
            UserError: with the nearest value that would do, or the default where there is none.
        """
        if isinstance(value, dict | list | tuple):
            for element in value.values() if isinstance(value, dict) else value:
                self.check(option, element)
        elif value is not None and not self._holds(value):
            shown = f"{value:.12g}" if isinstance(value, float) else value
            raise UserError(f"{option}={shown} is not {self}; try {option}={self._nearest(value, default)}")

    def _holds(self, value: Any) -> bool:
        if self.names:
            return value in self.names
        inside = self.low < value <= self.high if self.above else self.low <= value <= self.high
        return inside and math.isfinite(value) and (self.step == 1 or value % self.step == 0)

    def _nearest(self, value: Any, default: Any) -> Any:
        """Something to type instead."""
        if self.names:
            if isinstance(value, int | float):
                return min(self.names, key=lambda name: abs(float(name) - value))
            return (difflib.get_close_matches(str(value), map(str, self.names), 1) or self.names)[0]
        if (self.above and value <= self.low) or not math.isfinite(value):
            fallback = self.high if math.isfinite(self.high) else self.low + 1
            return f"{default if isinstance(default, int | float) else fallback:.12g}"
        nearest = min(max(value, self.low), self.high)
        return f"{max(nearest // self.step, 1) * self.step if self.step > 1 else nearest:.12g}"


def at_least(low: float) -> Bounds:
    """``low`` or more."""
    return Bounds(low)


def above(low: float, high: float = math.inf) -> Bounds:
    """More than ``low``, at most ``high``."""
    return Bounds(low, high, above=True)


def between(low: float, high: float) -> Bounds:
    """From ``low`` to ``high``, both included."""
    return Bounds(low, high)


def multiple_of(step: int, high: float = math.inf) -> Bounds:
    """``step``, twice ``step``, ... up to ``high``."""
    return Bounds(step, high, step=step)


def one_of(*names: str | int) -> Bounds:
    """One of these names or whole numbers."""
    return Bounds(names=names)


def bounds_of(annotation: Any) -> Bounds | None:
    """The bounds inside a type, ``Annotated[float, between(0, 1)] | None`` for instance."""
    found = (part if isinstance(part, Bounds) else bounds_of(part) for part in get_args(annotation))
    return next((part for part in found if part is not None), None)
