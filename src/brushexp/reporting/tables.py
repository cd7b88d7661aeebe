"""Write tables as CSV, Markdown and LaTeX."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from numbers import Real
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    from pandas import DataFrame

    # A row per element and a column per key, or a data frame without its index.
    Rows: TypeAlias = DataFrame | Sequence[Mapping[str, Any]] | Mapping[str, Sequence[Any]]

MISSING = "–"  # text in place of a missing number
NUMBER = re.compile(rf"([-+]?\d[\d.,e+-]*( ± [\d.e+-]+)?|-?inf|{MISSING}|)")  # a number or the text in its place


def csv_table(rows: Rows, significant: int | None = None) -> str:
    """Return a table as CSV, with floats rounded to ``significant`` digits (None: all) and missing numbers empty."""
    frame = _frame(rows)
    if significant is not None:
        frame = frame.map(lambda x: f"{x:.{significant}g}" if isinstance(x, float) and math.isfinite(x) else x)
    return str(frame.to_csv(index=False, lineterminator="\n"))


def markdown_table(
    rows: Rows, digits: Mapping[str, int] | None = None, align: str | None = None, *, escape: bool = True
) -> str:
    """Return a table as Markdown.

    ``digits`` gives the number of decimals of each column. ``align`` has "l" or "r" for each column, as in LaTeX; None
    right-aligns columns of numbers. If ``escape`` is False, the cells must already be Markdown.
    """
    texts = as_text(_frame(rows), digits or {})
    quote = escape_markdown if escape else str
    rules = ["---:" if side == "r" else "---" for side in align or _alignment(texts)]
    lines = [map(quote, texts), rules, *(map(quote, line) for line in texts.to_numpy())]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def latex_table(rows: Rows, digits: Mapping[str, int] | None = None) -> str:
    """Return a table as LaTeX with booktabs rules; the arguments are those of `markdown_table`."""
    texts = as_text(_frame(rows), digits or {})
    text = str(texts.to_latex(index=False, escape=True, column_format=_alignment(texts)))
    return text.replace("±", r"$\pm$").replace(MISSING, "--")


def as_text(frame: DataFrame, digits: Mapping[str, int]) -> DataFrame:
    """Format every cell as text, with the number of decimals that ``digits`` gives for its column."""
    return frame.apply(lambda column: column.map(lambda value: _format(value, digits.get(column.name))))


def _frame(rows: Rows) -> DataFrame:
    import pandas as pd  # noqa: PLC0415

    return pd.DataFrame(rows, dtype=object)


def _format(value: Any, digits: int | None) -> str:
    if value is None or value != value:  # noqa: PLR0124 (not a number)
        return MISSING
    return f"{value:.{digits}f}" if digits is not None and isinstance(value, Real) else str(value)


def _alignment(texts: DataFrame) -> str:
    """Return the alignment of the columns, such as ``"lrr"``; columns of numbers are right-aligned."""
    return "".join("r" if all(map(NUMBER.fullmatch, column)) and any(column) else "l" for _, column in texts.items())


def escape_markdown(text: str) -> str:
    r"""Escape text on one line so that Markdown shows it literally: ``a|b_c`` becomes ``a\|b\_c``."""
    return re.sub(r"([\\`*_\[\]<>|~$&])", r"\\\1", " ".join(text.split()))
