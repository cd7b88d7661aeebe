"""Declare and read the keys of a task; Hydra, `--help`, messages and documentation read the same lines."""

from dataclasses import MISSING as NO_DEFAULT
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, get_type_hints

from omegaconf import DictConfig, OmegaConf

from brushexp.bounds import ANY, Bounds, Rule


def key(default: Any, meaning: str, bounds: Bounds | Rule = ANY) -> Any:
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
    bounds: Bounds | Rule


def keys_of(schema: type[Any], above: str = "") -> dict[str, Key]:
    """All keys of a task, those below others too, by what is typed; those that every task has come last."""
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
    """The plugin families and other groups of configs that a task takes."""
    return [name for name in {**schema.groups, **schema.presets} if "@" not in name]


def typed(schema: type[Any], values: DictConfig) -> DictConfig:
    """Values of a task's keys and groups, those of its keys as the schema types them; OmegaConf's errors if not."""
    return OmegaConf.merge(untied(OmegaConf.structured(schema)), values)  # type: ignore[return-value]


def untied(node: DictConfig) -> DictConfig:
    """The same typed values in a mapping that belongs to no class, so that groups can stand beside them."""
    children = ((name, node._get_node(name)) for name in node)
    return DictConfig({name: untied(child) if isinstance(child, DictConfig) else child for name, child in children})
