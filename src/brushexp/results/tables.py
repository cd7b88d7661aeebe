"""Tables as CSV, Markdown and LaTeX: one way to write any of them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from numbers import Real
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    from pandas import DataFrame

    # A row per element, or a column per key, or a data frame, whose index is not shown.
    Rows: TypeAlias = DataFrame | Sequence[Mapping[str, Any]] | Mapping[str, Sequence[Any]]

MISSING = "–"  # in place of a number that is not known


def csv_table(rows: Rows, significant: int | None = None) -> str:
    """A table as CSV: what is missing is empty.

    Args:
        rows: a list with a dictionary per row, a dictionary with a list per column, or a data frame.
        significant: digits of a float; None writes it in full precision.
    """
    frame = _frame(rows)
    if significant is not None:
        frame = frame.map(lambda value: _rounded(value, significant) if isinstance(value, float) else value)
    return str(frame.to_csv(index=False, lineterminator="\n"))


def markdown_table(
    rows: Rows, digits: Mapping[str, int] | None = None, align: str | None = None, *, escape: bool = True
) -> str:
    """A table as Markdown, without a line break at its end.

    Args:
        rows: as of `csv_table`.
        digits: column -> digits after the point of its numbers; the other values are shown as they are.
        align: "l" or "r" for each column, as in LaTeX; None sets columns of numbers on the right.
        escape: show every letter as it is, also those that mean something to Markdown.
    """
    frame = _frame(rows)
    align = align or alignment(frame)
    shown = as_text(frame, digits or {})
    lines = [list(shown), ["---:" if side == "r" else "---" for side in align], *shown.to_numpy().tolist()]
    quoted = [line if k == 1 or not escape else map(escaped, line) for k, line in enumerate(lines)]
    return "\n".join(f"| {' | '.join(line)} |" for line in quoted)


def latex_table(rows: Rows, digits: Mapping[str, int] | None = None, align: str | None = None) -> str:
    r"""A table as LaTeX, with the rules of the package booktabs; arguments as of `markdown_table`."""
    frame = _frame(rows)
    text = as_text(frame, digits or {}).to_latex(index=False, escape=True, column_format=align or alignment(frame))
    return str(text).replace("±", r"$\pm$").replace(MISSING, "--")


def as_text(frame: DataFrame, digits: Mapping[str, int]) -> DataFrame:
    """Every cell as it is shown: floats rounded to the digits of their column."""
    return frame.apply(lambda column: column.map(lambda value: _shown(value, digits.get(column.name))))


def alignment(frame: DataFrame) -> str:
    """Columns of numbers stand on the right: ``"lrr"``."""
    numeric = [all(value is None or _is_number(value) for value in column) for _, column in frame.items()]
    return "".join("r" if is_numeric else "l" for is_numeric in numeric)


def escaped(text: str) -> str:
    r"""Markdown that shows exactly this text: ``a|b_c`` becomes ``a\|b\_c``."""
    return re.sub(r"([\\`*_\[\]<>|~$&])", r"\\\1", " ".join(text.split()))


def _frame(rows: Rows) -> DataFrame:
    import pandas as pd  # noqa: PLC0415

    return rows.astype(object) if isinstance(rows, pd.DataFrame) else pd.DataFrame(rows, dtype=object)


def _shown(value: Any, digits: int | None) -> str:
    if value is None or (_is_number(value) and math.isnan(value)):
        return MISSING
    return f"{value:.{digits}f}" if _is_number(value) and digits is not None else str(value)


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def _rounded(value: float, significant: int) -> str:
    return f"{value:.{significant}g}" if math.isfinite(value) else ""
