"""How the keys of a task are declared and read.

`publish` puts them where Hydra looks for ``task=<name>``, so that a wrong key or type is refused when a config is
composed; `--help`, the error messages and the documentation read the same lines of `schema`.
"""

from collections.abc import Collection, Mapping
from dataclasses import MISSING as NO_DEFAULT
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, get_type_hints

from hydra.core.config_store import ConfigStore
from omegaconf import DictConfig, OmegaConf

from brushexp.bounds import ANY, Bounds, Rule
from brushexp.registry import MULTI_SELECT

OPTIONS = "look_options"  # group of what looks set of plugins: look_options/<family>/<look>_<plugin>


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
    found: dict[str, Key] = {}
    inherited = {item.name for base in schema.__bases__ if is_dataclass(base) for item in fields(base)}
    for item in sorted(fields(schema), key=lambda item: item.name in inherited):
        name = above + item.name
        if item.metadata:
            default = item.default if item.default_factory is NO_DEFAULT else item.default_factory()
            found[name] = Key(name, hints[item.name], default, **item.metadata)
        else:
            found |= keys_of(hints[item.name], f"{name}.")
    return found


def groups_of(schema: type[Any]) -> list[str]:
    """The plugin families and other groups of configs that a task takes."""
    return [name for name in {**schema.groups, **schema.presets} if "@" not in name]


def publish(tasks: Mapping[str, type[Any]], tuned: Collection[str] = ()) -> None:
    """Make every task, by its name, a choice of Hydra's group ``task``; looks set options of ``tuned`` families."""
    for name, schema in tasks.items():
        groups = [{f"/{group}": chosen} for group, chosen in schema.groups.items()]
        if "look" in schema.presets:
            groups += [{f"optional /{OPTIONS}/{family}@{family}": f"${{look}}_${{{family}}}"} for family in tuned]
        presets = [{f"/{group}": chosen} for group, chosen in schema.presets.items()]
        several: dict[str, Any] = {family: {} for family in MULTI_SELECT if family in schema.groups}  # for loss=[]
        head = {"defaults": [*groups, "_self_", *presets], "task": name, **several}
        node = OmegaConf.merge(head, _untied(OmegaConf.structured(schema)), schema.settings)
        ConfigStore.instance().store(group="task", name=name, node=node, package="_global_", provider="brushexp")


def typed(schema: type[Any], values: DictConfig) -> DictConfig:
    """Values of a task's keys and groups, those of its keys as the schema types them; OmegaConf's errors if not."""
    return OmegaConf.merge(_untied(OmegaConf.structured(schema)), values)  # type: ignore[return-value]


def _untied(node: DictConfig) -> DictConfig:
    """The same typed values in a mapping that belongs to no class, so that groups can stand beside them."""
    children = ((name, node._get_node(name)) for name in node)
    return DictConfig({name: _untied(child) if isinstance(child, DictConfig) else child for name, child in children})
