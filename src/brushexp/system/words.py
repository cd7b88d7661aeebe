"""The vocabulary files (``words.toml``) and ``conf`` folders of the program and its packages.

A vocabulary file has tables of spellings, examples and short forms, so that the core does not have to mention packages.
"""

import tomllib
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from brushexp.system.published import entry_points_of

SHIPPED = Path(__file__).parents[1] / "conf"
CONF_POINTS = "brushexp.conf"  # entry-point group: package -> module with a folder ``conf``
WORDS_FILE = "words.toml"


@cache
def conf_folders() -> list[Path]:
    """Return the shipped config folders, the core's own folder first."""
    specs = (find_spec(point.module) for point in entry_points_of(CONF_POINTS).values())
    places = [place for spec in specs if spec is not None for place in spec.submodule_search_locations or ()]
    return [SHIPPED, *sorted(Path(place) / "conf" for place in places)]


@cache
def _tables() -> dict[str, dict[str, Any]]:
    """Read the vocabulary files of the core and the packages, and merge them table by table."""
    tables: dict[str, dict[str, Any]] = {}
    for path in (folder / WORDS_FILE for folder in conf_folders()):
        if path.is_file():
            for name, table in tomllib.loads(path.read_text(encoding="utf-8")).items():
                known = tables.setdefault(name, {})
                lists = {ours: [*known.get(ours, []), *said] for ours, said in table.items() if isinstance(said, list)}
                known |= table | lists
    return tables


def table_of_words(table: str) -> dict[str, Any]:
    """Return a table merged from all vocabulary files; ``alone``, for example, maps bare words to their meanings."""
    return dict(_tables().get(table, {}))
