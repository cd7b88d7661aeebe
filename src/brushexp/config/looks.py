"""Publish looks, files of overrides ``conf/look/<name>.yaml`` that say how a painting is made: ``look=oil``.

Options of plugins are taken out of a look and published one by one under the names of the look and of the plugin: the
defaults lists of tasks, losses and changes then load those of the plugins that a run chooses. So a typed
``renderer=analytic`` keeps the rest of a look.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hydra.core.config_store import ConfigStore
from hydra.core.object_type import ObjectType
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import ConfigKeyError, OmegaConfBaseException

from brushexp.config.check import unknown_option
from brushexp.config.schema import PaintTask
from brushexp.config.tasks import task_for
from brushexp.errors import UserError
from brushexp.pictures.abstraction import FEWER
from brushexp.registry import FAMILIES, plugins

LOOK_OPTIONS = "look_options"  # group of the options that looks set: look_options/<family>/<look>_<plugin>
UNTUNED = "untuned"  # group of losses and changes as they are without a look
TUNED_LISTS = ("loss", "change")  # families of several members of which looks set options
SCALED = ("steps", "pixels_per_stroke", "max_strokes", "focus_strength")  # keys of looks that other keys scale
CLOSER = 50  # times as much weight of the focus with abstraction=1
AT_A_GLANCE = {  # starts of looks, and what replaces them and their optimizer for strokes that a network lays
    "slic": {"init": "predicted", "adam": "brief", "shaped": "briefly_shaped"},
    "layers": {"init": "brushed"},
}
LAYERS = 3  # more with abstraction=1, so that the smallest strokes are as small as before


def scale(key: str, value: float, *, _root_: DictConfig) -> int | float:
    """Adapt the value of a look for a key to ``detail``, ``effort`` and ``abstraction``; whole numbers stay whole."""
    fewer = FEWER**_root_.abstraction
    scaled: dict[str, int | float] = {
        "steps": round(value * _root_.effort),
        "pixels_per_stroke": value * fewer / _root_.detail,
        "max_strokes": round(value * _root_.detail / fewer),
        "focus_strength": value * CLOSER**_root_.abstraction,
        "layers": round(value + LAYERS * _root_.abstraction),
    }
    return scaled[key]


def at_a_glance(look: str, family: str) -> str:
    """Choose of a family what suits strokes of a network, but where the look's own start makes it what it is."""
    store = ConfigStore.instance()
    node = store.load(f"look/{look}.yaml").node
    chosen = {of: str(name) for of, name in choices_of(node, PaintTask.groups).items()}
    tuned = store.get_type(f"{LOOK_OPTIONS}/optimizer/{look}_{chosen['optimizer']}.yaml") is ObjectType.CONFIG
    if OmegaConf.select(node, "style.brushwork") or (family == "optimizer" and tuned):
        return chosen[family]
    replaced = family if family == "init" else chosen[family]
    return AT_A_GLANCE.get(chosen["init"], {}).get(replaced, chosen[family])


def by_checkpoint(values: Mapping[str, float], otherwise: float, *, _root_: DictConfig) -> float:
    """Choose by the network that lays the first strokes, if one does."""
    return values.get(str(_root_.init.get("checkpoint")), otherwise)


OmegaConf.register_new_resolver("scaled", scale, replace=True)
OmegaConf.register_new_resolver("at_a_glance", at_a_glance, replace=True)
OmegaConf.register_new_resolver("by_checkpoint", by_checkpoint, replace=True)


def offer_looks(paths: Mapping[str, Path], schema: type[Any]) -> set[str]:
    """Publish looks for a task, and list the families of one member of which they set options."""
    tuned: dict[str, set[str]] = {}
    for name, path in paths.items():
        values = read_look(path)
        for family, plugin, options in take_out(values, schema.groups):
            check_options(path, family, plugin, options)
            if family == "init" and "layers" in options:
                options.layers = as_scaled("layers", options.layers)
            tuned.setdefault(family, set()).add(plugin)
            ConfigStore.instance().store(
                group=f"{LOOK_OPTIONS}/{family}", name=f"{name}_{plugin}", node=options, provider=str(path)
            )
        for key in SCALED:
            values[key] = as_scaled(key, values.get(key, getattr(schema, key)))
        ConfigStore.instance().store(group="look", name=name, node=values, package="_global_", provider=str(path))
    for family in TUNED_LISTS:
        for member in tuned.pop(family, ()):
            make_tunable(family, member)
    return set(tuned)


def read_look(path: Path) -> DictConfig:
    """Read the file of a look; a UserError if plugins, or their options, do not stand where Hydra looks for them."""
    look = OmegaConf.load(path)
    if not isinstance(look, DictConfig):
        raise UserError(f"{path} sets nothing; a look has lines like 'steps: 100'")
    plain: Any = OmegaConf.to_container(look)
    for part in plain.get("defaults") or []:
        if part != "_self_" and not (isinstance(part, dict) and all(str(key).startswith("override /") for key in part)):
            cure = "write '- override /init: slic'; one look upon another is a study with '- override /look: oil'"
            raise UserError(f"{path}: {part} in its defaults chooses no plugin; {cure}")
    chosen = {family: plain[family] for family in FAMILIES if family in plain}
    lists = {family: chosen[family] for family in TUNED_LISTS if isinstance(chosen.get(family), dict)}
    members = [(family, options) for family, parts in lists.items() for options in parts.values()]
    for family, options in [*chosen.items(), *members]:
        if not isinstance(options, dict):
            cure = f"options stand below '{family}:', and '- override /{family}: ...' in the defaults chooses it"
            raise UserError(f"{path}: {family} is {options}; {cure}")
    return look


def as_scaled(key: str, value: object) -> object:
    """Let `scale` adapt a number of a look."""
    return f"${{scaled:{key},{value}}}" if isinstance(value, int | float) else value


def look_names() -> list[str]:
    """List the published looks of ``task=paint`` in alphabetical order; some ask for other tasks."""
    names = sorted(name.removesuffix(".yaml") for name in ConfigStore.instance().list("look"))
    return [name for name in names if task_for("paint", {"look": name}) == "paint"]


def take_out(look: DictConfig, groups: Mapping[str, Any]) -> list[tuple[str, str, DictConfig]]:
    """Take options out of a look, each with its family and the plugin that the look, or else the task, chooses."""
    chosen, parts = choices_of(look, groups), []
    for family in FAMILIES:
        if family in TUNED_LISTS:
            parts += [(family, str(name), options) for name, options in look.pop(family, {}).items()]
        elif family in look and isinstance(chosen.get(family), str):
            parts.append((family, chosen[family], look.pop(family)))
    return parts


def choices_of(look: DictConfig, groups: Mapping[str, Any]) -> dict[str, Any]:
    """Map the families of a task to what a look, or else the task, chooses."""
    chosen = dict(groups)
    for entry in look.get("defaults") or []:
        if entry != "_self_":
            chosen |= {str(key).removeprefix("override /"): value for key, value in entry.items()}
    return chosen


def check_options(path: Path, family: str, name: str, options: DictConfig) -> None:
    """Stop with a UserError when a plugin does not have options that a file sets of it."""
    for plugin in plugins(family):
        if plugin.name == name:
            try:
                OmegaConf.merge(OmegaConf.structured(plugin.config), options)
            except OmegaConfBaseException as error:
                is_unknown = isinstance(error, ConfigKeyError)
                reason = unknown_option(str(error.key), plugin) if is_unknown else error.msg
                raise UserError(f"{path} does not fit {family}={name}: {reason}; correct it") from error


def make_tunable(family: str, member: str) -> None:
    """Publish a loss or change anew, so that ``look=`` sets its options wherever it is chosen."""
    store, untuned = ConfigStore.instance(), f"{UNTUNED}/{family}"
    published = [store.get_type(f"{group}/{member}.yaml") is ObjectType.CONFIG for group in (family, untuned)]
    if published == [True, False]:
        own = store.load(f"{family}/{member}.yaml")
        store.store(group=untuned, name=member, node=own.node, provider=own.provider)
        parts = [
            "_self_",
            f"/{untuned}/{member}@_here_",
            {f"optional /{LOOK_OPTIONS}/{family}@_here_": f"${{look}}_{member}"},
        ]
        package = f"{family}.{member}"
        store.store(group=family, name=member, node={"defaults": parts}, package=package, provider=own.provider)
