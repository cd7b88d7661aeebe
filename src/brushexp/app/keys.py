"""How the keys of a task are declared and read.

`publish` puts them where Hydra looks for ``task=<name>``, so that a wrong key or type is refused when a config is
composed; `--help`, the error messages and the documentation read the same lines of `schema`.
"""

from __future__ import annotations

import types
from collections.abc import Mapping
from dataclasses import MISSING as NO_DEFAULT
from dataclasses import dataclass, field, fields, is_dataclass
from enum import Enum
from typing import Any, Union, get_args, get_origin, get_type_hints

from hydra.core.config_store import ConfigStore
from omegaconf import DictConfig, OmegaConf

from brushexp.bounds import Bounds
from brushexp.registry import MULTI_SELECT


def key(default: Any, meaning: str, bounds: Bounds | None = None) -> Any:
    """Declare a key; ``MISSING`` as its default makes it one that must be given."""
    metadata = {"meaning": meaning, "bounds": bounds}
    if isinstance(default, list):
        return field(default_factory=lambda: list(default), metadata=metadata)
    return field(default=default, metadata=metadata)


@dataclass(frozen=True)
class Key:
    """One key of a task, as it is typed."""

    name: str
    annotation: Any
    default: Any
    meaning: str
    bounds: Bounds | None

    @property
    def type(self) -> str:
        """What it takes, in words."""
        if self.bounds is not None and self.bounds.names:
            return str(self.bounds)
        return kind_of(self.annotation) + (f", {self.bounds}" if self.bounds else "")

    @property
    def is_list(self) -> bool:
        """Whether it takes several values."""
        return any(get_origin(part) is list for part in (self.annotation, *get_args(self.annotation)))


def keys_of(schema: type[Any], above: str = "") -> dict[str, Key]:
    """All keys of a task, those below others too, by what is typed; those that every task has come last."""
    hints = get_type_hints(schema)
    found: dict[str, Key] = {}
    inherited = {item.name for base in schema.__bases__ if is_dataclass(base) for item in fields(base)}
    own = [item for item in fields(schema) if item.name not in inherited]
    for item in own + [item for item in fields(schema) if item not in own]:
        if not item.metadata:
            found |= keys_of(hints[item.name], f"{above}{item.name}.")
            continue
        default = item.default_factory() if item.default_factory is not NO_DEFAULT else item.default
        name = above + item.name
        found[name] = Key(name, hints[item.name], default, item.metadata["meaning"], item.metadata["bounds"])
    return found


def kind_of(annotation: Any) -> str:
    """A type in words."""
    if get_origin(annotation) in (types.UnionType, Union):
        return " or ".join(kind_of(part) for part in get_args(annotation) if part is not type(None)) + " or null"
    if get_origin(annotation) is list:
        return f"list of {kind_of(get_args(annotation)[0])}"
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        return f"one of {', '.join(annotation.__members__)}"
    words = {int: "whole number", float: "number", bool: "true or false", str: "text"}
    return words.get(annotation, getattr(annotation, "__name__", str(annotation)))


def groups_of(schema: type[Any]) -> list[str]:
    """The plugin families and other groups that a task takes, in the order of its defaults list."""
    named = [name.strip("/") for entry in schema.defaults if isinstance(entry, dict) for name in entry]
    return [name for name in named if "@" not in name]


def publish(tasks: Mapping[str, type[Any]]) -> None:
    """Make every task, by its name, a choice of Hydra's group ``task``."""
    for name, schema in tasks.items():
        several: dict[str, Any] = {
            family: {} for family in MULTI_SELECT if family in groups_of(schema)
        }  # keeps the key of loss=[]
        typed = _untied(OmegaConf.structured(schema))
        node = OmegaConf.merge({"task": name}, several, typed, schema.settings)
        node = OmegaConf.merge({"defaults": schema.defaults or ["_self_"]}, node)
        ConfigStore.instance().store(group="task", name=name, node=node, package="_global_", provider="brushexp")


def _untied(node: DictConfig) -> DictConfig:
    """The same typed values in a mapping that belongs to no class, so that groups can stand beside them."""
    children = {name: node._get_node(name) for name in node}
    return DictConfig(
        {name: _untied(child) if isinstance(child, DictConfig) else child for name, child in children.items()}
    )
