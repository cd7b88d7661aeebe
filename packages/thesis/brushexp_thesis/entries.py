"""Read YAML entries as dataclasses; for an invalid entry, raise a UserError that names the entry and its key."""

from dataclasses import fields
from pathlib import Path
from textwrap import shorten
from typing import Any, TypeVar

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from brushexp.contracts import UserError
from brushexp.contracts.files import read_text, shorten_value, yaml_of

Kind = TypeVar("Kind")


def read_plain_yaml(path: Path, cure: str) -> dict[str, Any]:
    """Read a mapping from a YAML file; raise UserError if it contains interpolations (``${...}``)."""
    text = read_text(path, cure)
    if "${" in text:
        raise UserError("${...} refers to something else; write the value itself")
    return yaml_of(text)


def entries_in(kind: type[Kind], listed: Any, where: str) -> list[Kind]:
    """Convert a list of mappings to dataclasses of type ``kind``."""
    if not isinstance(listed, list):
        raise UserError(f"{where} is {shorten_value(listed)}; give a list of entries")
    return [entry_of(kind, entry, f"entry {number} of {where}") for number, entry in enumerate(listed, 1)]


def entry_of(kind: type[Kind], mapping: Any, where: str) -> Kind:
    """Convert a mapping to a dataclass of type ``kind``, with values converted to the types of its fields."""
    keys = ", ".join(field.name for field in fields(kind))  # type: ignore[arg-type]
    if not isinstance(mapping, dict):
        raise UserError(f"{where} is {shorten_value(mapping)}; give a mapping of {keys}")
    try:
        config = OmegaConf.merge(kind, mapping)
        if missing := OmegaConf.missing_keys(config):
            raise UserError(f"{where} has no {' and no '.join(sorted(missing))}; its keys are {keys}")
        return OmegaConf.to_object(config)  # type: ignore[return-value]
    except OmegaConfBaseException as error:
        reason = shorten(str(error).partition("\n")[0], 160)
        raise UserError(f"{where}: {error.full_key}: {reason}; its keys are {keys}") from error
