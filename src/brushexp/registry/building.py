"""Build plugins from config nodes and from names in files; build only registered classes."""

import json
import re
from typing import Any

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import MissingMandatoryValue, OmegaConfBaseException

from brushexp.errors import UserError
from brushexp.registry.families import CORE, FAMILIES, FOLDERS, SEARCH_PATH
from brushexp.registry.plugin import Plugin, member, plugins
from brushexp.system.reading import check_plain, shorten_value

LOSSES_OF_STYLE = "style"  # key of losses that are not in the list ``loss``

_kept: dict[str, Any] = {}  # config node as YAML -> plugin that a check built from it


def plugin_of(node: DictConfig, family: str = "") -> Plugin:
    """Return the plugin named by a config node's ``_target_``; raise a UserError if it is not registered.

    A target has the form ``family/name``. Files written by brushexp 0.1 hold the path of the class instead, which may
    have moved since. The family then follows from the path if the class is one of brushexp's own, and otherwise from
    ``family`` or the node's key.
    """
    target = str(node._target_)
    if "/" in target:
        family, _, name = target.partition("/")
        plugin = member(family, name)
    else:
        plugin = _member_of_class(target, family or family_of_key(str(node._get_full_key(None))))
    if plugin is None:
        raise UserError(
            f"{shorten_value(target)} is not a registered plugin; add the file that defines it to {SEARCH_PATH}"
        )
    return plugin


def name_of_target(target: str, family: str) -> str:
    """Return the name of the member with this ``_target_``, or the target itself if its class is not registered.

    >>> name_of_target("order/area", "order"), name_of_target("brushexp.plugins.order.area.Area", "order")
    ('area', 'area')
    """
    if "/" in target:
        return target.partition("/")[2]
    found = _member_of_class(target, family)
    return target if found is None else found.name


def _member_of_class(path: str, family: str) -> Plugin | None:
    """Return the member for a class path from an earlier version, found by family, module name and class name."""
    module, _, name = path.rpartition(".")
    if match := re.match(rf"{re.escape(CORE)}plugins\.(\w+)\.", path):
        folder = match[1]
        family = next((one for one in FAMILIES if FOLDERS[one] == folder), family)
    candidates = plugins(family) if family else plugins()
    candidates.sort(key=lambda plugin: plugin.name != module.rpartition(".")[2])  # most are named after their file
    return next((plugin for plugin in candidates if plugin.cls.__qualname__ == name), None)


def family_of_key(key: str) -> str:
    """Return the family of the plugin at a config key, or "" if there is none.

    >>> family_of_key("loss.mse.weight"), family_of_key("style.loss"), family_of_key("steps")
    ('loss', 'loss', '')
    """
    first = key.partition(".")[0]
    return "loss" if first == LOSSES_OF_STYLE else first if first in FAMILIES else ""


def build(node: DictConfig, *runtime: object, family: str = "") -> Any:
    """Build the plugin that a config node describes; raise a UserError that names any option it does not accept."""
    plugin = plugin_of(node, family)
    options = options_in(node, plugin.path, family)
    attributes = {name: options.pop(name) for name in getattr(plugin.cls, "tunable", ())}
    built = plugin.cls(*runtime, **options)
    for name, value in attributes.items():
        setattr(built, name, value)
    return built


def keep_built(node: DictConfig) -> Any:
    """Build a config node's plugin for a check, and keep it for the run (see `take_built`)."""
    text = OmegaConf.to_yaml(node, resolve=True)
    if text not in _kept:
        _kept[text] = build(node)
    return _kept[text]


def take_built(node: DictConfig) -> Any:
    """Return the plugin that a check built for a config node, or else a new one; no object is returned twice."""
    text = OmegaConf.to_yaml(node, resolve=True)
    return _kept.pop(text) if text in _kept else build(node)


def drop_built() -> None:
    """Discard the plugins that checks built and no run used."""
    _kept.clear()


def options_in(node: DictConfig, path: str, family: str = "") -> dict[str, Any]:
    """Read a plugin's options from its config node; raise a UserError for values that the plugin does not accept."""
    plugin = plugin_of(node, family)
    typed: DictConfig = OmegaConf.structured(plugin.config)
    try:
        typed.merge_with(literal(OmegaConf.to_container(node, resolve=True)))  # a worker has copies of our types
        options: Any = OmegaConf.to_container(typed, resolve=True, throw_on_missing=True)
    except MissingMandatoryValue as error:
        missing = f"{path}.{error.full_key}"
        raise UserError(
            f"{plugin.family}={plugin.name} needs {missing}, which has no default; type {missing}=..."
        ) from error
    except OmegaConfBaseException as error:
        reason = " ".join(str(error).split())
        raise UserError(f"{plugin.family}={plugin.name} does not accept these options: {reason}") from error
    del options["_target_"]
    if hidden := _hidden_key(options):
        raise UserError(f"{path} has an option {hidden}, which is not allowed below a plugin; drop that key")
    plugin.check(path, options)
    return options


def literal(data: Any) -> Any:
    """Escape the strings in nested data so that OmegaConf does not interpolate them."""
    if isinstance(data, str):
        return re.sub(r"(\\*)\$\{", r"\1\1\\${", data)
    if isinstance(data, dict):
        return {key: literal(value) for key, value in data.items()}
    return [literal(value) for value in data] if isinstance(data, list) else data


def _hidden_key(data: Any) -> str:
    """Return the first key that begins with ``_``, as Hydra's keys for locating code do, or "" if there is none."""
    if isinstance(data, dict):
        own = (key for key in data if str(key).startswith("_"))
        return str(next(own, "")) or _hidden_key(list(data.values()))
    return next(filter(None, map(_hidden_key, data)), "") if isinstance(data, list) else ""


def build_named(family: str, name: str, options: dict[str, Any], *runtime: object) -> Any:
    """Build ``family=name`` with options from a file; raise a UserError for an unregistered class or unknown key."""
    plugin = member(family, name)
    if plugin is None:
        choices = ", ".join(one.name for one in plugins(family))
        raise UserError(
            f"{family}={shorten_value(name)} is not among the plugins here ({choices}); add the file that defines it"
        )
    return build(plain_config(options | {"_target_": plugin.target}), *runtime)


def plain_config(values: dict[str, Any]) -> DictConfig:
    """Convert values from a file into a config; raise a UserError for an interpolation, which could read other data."""
    if "${" in json.dumps(check_plain(values)):
        raise UserError("a config from a file holds an interpolation, ${...}; write the value instead")
    config: DictConfig = OmegaConf.create(values)
    return config
