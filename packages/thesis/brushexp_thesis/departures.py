"""``task=departures``: list every setting in which finished paintings depart from the thesis's procedure."""

import json
import logging
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from omegaconf import DictConfig

from brushexp.contracts import UserError
from brushexp.contracts.files import as_shown, read_text, write_text, yaml_of
from brushexp.contracts.pages import list_settings
from brushexp.contracts.results import escape_markdown, gather, markdown_table
from brushexp.contracts.strokes import config_of, load_catalogue

log = logging.getLogger(__name__)
THESIS = Path(__file__).with_name("thesis.yaml")
ABSENT = "absent"  # value of a setting that a run lacks


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Write ``departures.md``, which has one table for each painting among the runs in ``cfg.runs``."""
    folders = gather([Path(path) for path in cfg.runs], folder)["run", "folder"]
    catalogues = {name: path / "catalogue.h5" for name, path in folders.items() if (path / "catalogue.h5").is_file()}
    if not catalogues:
        raise UserError(f"runs={','.join(cfg.runs)}: no finished painting found; set runs= to folders that contain one")
    lines, counts = ["# Departures from the thesis", ""], []
    for name, path in catalogues.items():
        settings = list_settings(config_of(load_catalogue(path)), [])
        rows = list(departures({key: value for key, value, _ in settings}))
        lines += [f"## {escape_markdown(str(name))}", "", f"{len(rows)} settings differ.", "", markdown_table(rows), ""]
        counts.append(len(rows))
    write_text(folder / "departures.md", "\n".join(lines))
    log.info("%s: %s settings differ", as_shown(folder / "departures.md"), ", ".join(map(str, counts)))
    return {"paintings": len(counts), "departures": max(counts)}


def departures(settings: Mapping[str, str]) -> Iterator[dict[str, str]]:
    """Yield each ``setting`` in which a run departs from the thesis, with both values and the thesis's section.

    ``settings`` maps dotted keys to values as users type them, with plugins given by name.
    """
    for row in yaml_of(read_text(THESIS, ""), list):
        condition, _, value = row.get("with", "").partition("=")
        if condition and settings.get(condition) != value:
            continue
        allowed = row["value"] if isinstance(row["value"], list) else [row["value"]]
        own = settings.get(row["key"], ABSENT)
        if not any(_equal(own, one) for one in allowed):
            words = row.get("thesis") or " or ".join(map(_word_of, allowed))
            run = row.get("run", own)
            yield {"setting": row["key"], "thesis": words, "this run": run, "where": row["source"]}


def _word_of(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def _equal(own: str, allowed: Any) -> bool:
    try:
        return float(own) == float(_word_of(allowed))
    except ValueError:
        return own == _word_of(allowed)
