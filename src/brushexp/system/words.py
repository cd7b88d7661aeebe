"""Load words and presets from the ``conf`` folders and ``words.toml`` files of the program and of packages.

A vocabulary file has tables of spellings, examples and short forms, so that the core need not mention packages.
"""

import tomllib
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from brushexp.system.published import published

SHIPPED = Path(__file__).parents[1] / "conf"
CONF_POINTS = "brushexp.conf"  # entry-point group: package -> module with a folder ``conf``
WORDS_FILE = "words.toml"


@cache
def conf_folders() -> list[Path]:
    """List the shipped config folders, with the core's own folder first."""
    specs = (find_spec(point.module) for point in published(CONF_POINTS).values())
    places = [place for spec in specs if spec is not None for place in spec.submodule_search_locations or ()]
    return [SHIPPED, *sorted(Path(place) / "conf" for place in places)]


@cache
def _tables() -> dict[str, dict[str, Any]]:
    """Read the vocabulary files of the core and of packages."""
    tables: dict[str, dict[str, Any]] = {}
    for path in (folder / WORDS_FILE for folder in conf_folders()):
        if path.is_file():
            for name, table in tomllib.loads(path.read_text(encoding="utf-8")).items():
                known = tables.setdefault(name, {})
                lists = {ours: [*known.get(ours, []), *said] for ours, said in table.items() if isinstance(said, list)}
                known |= table | lists
    return tables


def table_of_words(table: str) -> dict[str, Any]:
    """Return a table of the vocabulary files; ``alone`` maps bare words to their meanings."""
    return dict(_tables().get(table, {}))
