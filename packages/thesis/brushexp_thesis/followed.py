"""A published procedure that a run follows: every setting in which the run differs from it."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from brushexp.system.reading import read_text, yaml_of

PROCEDURES = {"thesis": Path(__file__).with_name("thesis.yaml")}  # what ``follows`` may name
ABSENT = "not there"


def departures(procedure: str, settings: Mapping[str, str]) -> Iterator[dict[str, str]]:
    """Where a run departs from a procedure: ``key``, what the ``source`` has (``wanted``), what the ``run`` has.

    ``settings`` are dotted keys and values as they would be typed, plugins by their names.
    """
    for row in yaml_of(read_text(PROCEDURES[procedure], ""), list):
        condition, _, value = row.get("with", "").partition("=")
        if condition and settings.get(condition) != value:
            continue
        wanted = row["value"] if isinstance(row["value"], list) else [row["value"]]
        found = settings.get(row["key"], ABSENT)
        if not any(_same(found, one) for one in wanted):
            said = row.get("thesis") or " or ".join(map(_typed, wanted))
            yield {"key": row["key"], "wanted": said, "run": row.get("run", found), "source": row["source"]}


def _typed(value: Any) -> str:
    """A value as settings have it."""
    return value if isinstance(value, str) else json.dumps(value)


def _same(found: str, wanted: Any) -> bool:
    """Whether a setting has a value, whichever way its number is written."""
    try:
        return float(found) == float(_typed(wanted))
    except ValueError:
        return found == _typed(wanted)
