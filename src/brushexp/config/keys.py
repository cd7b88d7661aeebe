"""Declare the keys of a task, and list them for Hydra, `--help`, error messages and documentation."""

from dataclasses import MISSING as NO_DEFAULT
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, get_type_hints

from omegaconf import MISSING, DictConfig, OmegaConf

from brushexp.bounds import ANY, Bounds, Rule


def key(default: Any, meaning: str, bounds: Bounds | Rule = ANY) -> Any:
    """Declare a key of a task; a default of ``MISSING`` makes it mandatory."""
    metadata = {"meaning": meaning, "bounds": bounds}
    if isinstance(default, list):
        return field(default_factory=lambda: list(default), metadata=metadata)
    return field(default=default, metadata=metadata)


@dataclass(frozen=True)
class Key:
    """A key of a task, with its type, default, description and bounds."""

    name: str
    annotation: Any
    default: Any
    meaning: str
    bounds: Bounds | Rule

    def example(self) -> Any:
        """Return a value for messages to propose: a typical one or the default; "..." if there is neither."""
        value = self.bounds.example(self.default) if isinstance(self.bounds, Bounds) else self.default
        is_unknown = value is None or (isinstance(value, str) and ("${" in value or value == MISSING))
        return "..." if is_unknown else value


def keys_of(schema: type[Any], above: str = "") -> dict[str, Key]:
    """Map the full name of each key of a task to its declaration, with the keys common to all tasks last."""
    hints = get_type_hints(schema)
    keys: dict[str, Key] = {}
    inherited = {item.name for base in schema.__bases__ if is_dataclass(base) for item in fields(base)}
    for item in sorted(fields(schema), key=lambda item: item.name in inherited):
        name = above + item.name
        if item.metadata:
            default = item.default if item.default_factory is NO_DEFAULT else item.default_factory()
            keys[name] = Key(name, hints[item.name], default, **item.metadata)
        else:
            keys |= keys_of(hints[item.name], f"{name}.")
    return keys


def groups_of(schema: type[Any]) -> list[str]:
    """List the plugin families and other config groups of a task."""
    return [name for name in {**schema.groups, **schema.presets} if "@" not in name]


def with_types(schema: type[Any], values: DictConfig) -> DictConfig:
    """Convert the values of a task's keys to their declared types; OmegaConf raises an error if this fails."""
    return OmegaConf.merge(without_class(OmegaConf.structured(schema)), values)  # type: ignore[return-value]


def without_class(node: DictConfig) -> DictConfig:
    """Copy a typed config into a plain mapping, so that groups can be added."""
    children = ((name, node._get_node(name)) for name in node)
    return DictConfig(
        {name: without_class(child) if isinstance(child, DictConfig) else child for name, child in children}
    )
