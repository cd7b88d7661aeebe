"""YAML files of entries as dataclasses; a UserError names the entry and the key that is wrong."""

from dataclasses import fields
from pathlib import Path
from textwrap import shorten
from typing import Any, TypeVar

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from brushexp.errors import UserError
from brushexp.system.reading import in_short, read_text, yaml_of

Kind = TypeVar("Kind")
LONGEST_REASON = 160  # letters


def read_plain_yaml(path: Path, cure: str) -> dict[str, Any]:
    """The mapping in a YAML file, which may refer to nothing outside of itself."""
    text = read_text(path, cure)
    if "${" in text:
        raise UserError("${...} refers to something else; write the value itself")
    found: dict[str, Any] = yaml_of(text)
    return found


def entries_in(kind: type[Kind], listed: Any, where: str) -> list[Kind]:
    """A list of mappings as dataclasses."""
    if not isinstance(listed, list):
        raise UserError(f"{where} is {in_short(listed)}; give a list of entries")
    return [entry_of(kind, given, f"entry {number} of {where}") for number, given in enumerate(listed, 1)]


def entry_of(kind: type[Kind], given: Any, where: str) -> Kind:
    """A mapping as a dataclass, its values of the types of the fields."""
    keys = ", ".join(field.name for field in fields(kind))  # type: ignore[arg-type]
    if not isinstance(given, dict):
        raise UserError(f"{where} is {in_short(given)}; give a mapping of {keys}")
    try:
        config = OmegaConf.merge(kind, given)
        if missing := OmegaConf.missing_keys(config):
            raise UserError(f"{where} has no {' and no '.join(sorted(missing))}; its keys are {keys}")
        entry: Kind = OmegaConf.to_object(config)  # type: ignore[assignment]
    except OmegaConfBaseException as error:
        reason = shorten(str(error).partition("\n")[0], LONGEST_REASON)
        raise UserError(f"{where}: {error.full_key}: {reason}; its keys are {keys}") from error
    return entry
