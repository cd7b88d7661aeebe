"""Make a class choosable on the command line: ``@register("loss", "mse")`` gives ``loss=mse``.

Keyword-only parameters of ``__init__``, and class attributes that a contract lists as ``tunable``, are the plugin's
config. Positional parameters are objects that the framework passes at run time.
"""

import inspect
import json
import re
from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, field, fields, make_dataclass
from functools import cached_property, partial, reduce
from operator import or_
from types import UnionType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin

from hydra.core.config_store import ConfigStore
from omegaconf import MISSING, DictConfig, OmegaConf
from omegaconf.errors import MissingMandatoryValue, OmegaConfBaseException

from brushexp.bounds import ANY, Bounds, Rule, bounds_of
from brushexp.errors import UserError
from brushexp.plugin_errors import OURS, check_results
from brushexp.system.reading import check_plain, in_short

FAMILIES = {
    "painter": "target picture -> strokes, state after state",
    "palette": "colours of the picture -> colours of the painting",
    "init": "target picture -> first strokes",
    "renderer": "stroke parameters -> what each stroke covers",
    "blend": "strokes in depth order -> picture",
    "color": "in which space paint is laid over paint",
    "paper": "what the paint lies on: which of it stays bare, and its relief",
    "order": "strokes -> depth",
    "loss": "painting -> number to minimise",
    "metric": "finished painting -> number that says how good it is",
    "density": "when strokes are added and removed",
    "sampler": "which part of the canvas a step looks at",
    "optimizer": "how strokes move",
    "change": "what is different about this painting",
    "engine": "brush simulators: stroke parameters -> picture of one stroke",
    "callbacks": "what happens beside the steps of a fit",
    "logger": "where the curves of a run go",
    "to": "finished painting -> files that other programs read",
}
PACKAGES = {family: family for family in FAMILIES} | {"to": "export"}  # folder of each below `brushexp.plugins`
MULTI_SELECT = (
    "loss",
    "metric",
    "change",
    "callbacks",
    "logger",
    "to",
)  # families of which one run may use several members
SEARCH_PATH = "BRUSHEXP_PLUGINS"  # environment variable: more plugin folders

C = TypeVar("C", bound=type)


@dataclass(frozen=True)
class Plugin:
    """A registered class, chosen by ``family=name``, and its options."""

    family: str
    name: str
    cls: type
    config: type  # dataclass of its options
    bounds: dict[str, Bounds | Rule]  # each option has its bounds

    @property
    def target(self) -> str:
        return f"{self.cls.__module__}.{self.cls.__qualname__}"

    @property
    def target_in_core(self) -> str:
        return f"{__package__}.plugins.{PACKAGES[self.family]}.{self.name}.{self.cls.__qualname__}"

    @property
    def summary(self) -> str:
        return (inspect.getdoc(self.cls) or "").partition("\n")[0]

    @property
    def meanings(self) -> dict[str, str]:
        """Map each option to what the docstrings of the class and its bases say about it under ``Args:``."""
        texts: dict[str, str] = {}
        for cls in reversed(self.cls.__mro__):
            section = inspect.cleandoc(cls.__doc__ or "").partition("\nArgs:\n")[2].partition("\n\n")[0]
            entries = re.findall(r"^    (\w+): (.*(?:\n     .*)*)", section, re.MULTILINE)
            texts |= {name: " ".join(text.split()) for name, text in entries}
        return {item.name: texts.get(item.name, "") for item in fields(self.config) if item.name != "_target_"}

    @property
    def facts(self) -> dict[str, str]:
        """Map the names of facts by which one chooses among the family to their values."""
        return dict(getattr(self.cls, "facts", dict)())

    @property
    def path(self) -> str:
        """The key above its options."""
        return f"{self.family}.{self.name}" if self.family in MULTI_SELECT else self.family

    def check(self, path: str, options: Mapping[str, Any]) -> None:
        """Stop with a UserError when an option is out of its bounds; ``path`` is the key above it."""
        for option, bounds in self.bounds.items():
            value = options[option]
            plain = OmegaConf.to_object(value) if OmegaConf.is_config(value) else value
            bounds.check(f"{path}.{option}", plain, self._defaults.get(option))

    @cached_property
    def _defaults(self) -> dict[str, Any]:
        node: DictConfig = OmegaConf.structured(self.config)
        return {str(option): node[option] for option in node if not OmegaConf.is_missing(node, option)}


_plugins: dict[tuple[str, str], Plugin] = {}
_kept: dict[str, Any] = {}  # node of a config as YAML -> the plugin that a check has built of it


def register(family: str, name: str) -> Callable[[C], C]:
    """Publish the decorated class as the Hydra choice ``family=name``; a UserError if another has the name.

    >>> [plugin.name for plugin in plugins("order")]  # what the decorator has published
    ['accuracy', 'area', 'fixed']
    >>> build_named("order", "area", {"every": 5}).every
    5
    """
    if family not in FAMILIES:
        raise UserError(f"unknown plugin family {family!r}; choose one of {', '.join(FAMILIES)}")

    def publish(cls: C) -> C:
        if not isinstance(cls, type):
            raise UserError(f"{family}={name} is {cls!r}, not a class; write one, as docs/tutorial.md shows")
        owner = _plugins.get((family, name))
        if owner is not None and owner.cls.__module__ != cls.__module__:
            raise UserError(
                f"{family}={name} is taken by {owner.cls.__module__}; give the class in {cls.__module__} another name"
            )
        if not cls.__module__.startswith(OURS):
            check_results(family, name, cls, f"{OURS}plugins.{PACKAGES[family]}.base")
        bounds = {name: bounds_of(annotation) or ANY for name, annotation, _ in options_of(cls)}
        plugin = _plugins[family, name] = Plugin(family, name, cls, structured_config(cls), bounds)
        # A worker process of a sweep inherits a filled store and stores the same node again: no clash.
        ConfigStore.instance().store(
            group=family, name=name, node=plugin.config, package=plugin.path, provider=cls.__module__
        )
        return cls

    return publish


def options_of(cls: type) -> list[tuple[str, Any, Any]]:
    """List name, type and default (or ``MISSING``) of each option of a class; each keyword-only parameter is one."""
    tunable = getattr(cls, "tunable", {})
    options = [(name, kind, getattr(cls, name)) for name, kind in tunable.items()]
    for parameter in inspect.signature(cls, eval_str=True).parameters.values():
        if parameter.kind is not parameter.KEYWORD_ONLY:
            continue
        if parameter.annotation is parameter.empty:
            raise TypeError(f"{cls.__qualname__}.__init__: give '{parameter.name}' a type; it is a config key")
        if parameter.name in tunable:
            raise TypeError(f"{cls.__qualname__}: write '{parameter.name} = ...' in the class, not in __init__")
        default = MISSING if parameter.default is parameter.empty else parameter.default
        options.append((parameter.name, parameter.annotation, default))
    return options


def structured_config(cls: type) -> type:
    """Derive a structured config: one field per option of a class, without bounds, which OmegaConf does not know."""
    target = ("_target_", str, f"{cls.__module__}.{cls.__qualname__}")
    options = [
        (name, plain_type(kind), field(default_factory=partial(copy, value))) for name, kind, value in options_of(cls)
    ]
    return make_dataclass(f"{cls.__name__}Config", [target, *options])


def plain_type(annotation: Any) -> Any:
    """Strip a type, and its parts, of what ``Annotated`` adds."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return plain_type(parts[0])
    if origin in (UnionType, Union):
        return reduce(or_, map(plain_type, parts))
    if origin is None or Ellipsis in parts:
        return annotation
    return origin[tuple(map(plain_type, parts))]


def plugins(family: str | None = None) -> list[Plugin]:
    """List all registered plugins, or those of one family, by family and name."""
    chosen = [plugin for plugin in _plugins.values() if family in (None, plugin.family)]
    return sorted(chosen, key=lambda plugin: (list(FAMILIES).index(plugin.family), plugin.name))


def plugin_of(node: DictConfig) -> Plugin:
    """Find the plugin that a config node describes; a UserError if its ``_target_`` is not registered.

    A config of an earlier version may have a member in the core, ``brushexp.plugins.<family>.<name>``, that is in a
    package now.
    """
    target = node._target_
    for plugin in _plugins.values():
        if target in (plugin.target, plugin.target_in_core):
            return plugin
    raise UserError(f"{target} is not a registered plugin; add the file that defines it to {SEARCH_PATH}")


def build(node: DictConfig, *runtime: object) -> Any:
    """Build the plugin of a config node; a UserError says which option does not fit its registered class."""
    plugin = plugin_of(node)
    options = options_in(node, plugin.path)
    attributes = {name: options.pop(name) for name in getattr(plugin.cls, "tunable", ())}
    member = plugin.cls(*runtime, **options)
    for name, value in attributes.items():
        setattr(member, name, value)
    return member


def keep_built(node: DictConfig) -> Any:
    """Build the plugin of a config node once for the check of a run, and keep it for the run (`take_built`)."""
    text = OmegaConf.to_yaml(node, resolve=True)
    if text not in _kept:
        _kept[text] = build(node)
    return _kept[text]


def take_built(node: DictConfig) -> Any:
    """Take the plugin that a check has kept for a config node, or build one; no other run gets the same object."""
    text = OmegaConf.to_yaml(node, resolve=True)
    return _kept.pop(text) if text in _kept else build(node)


def drop_built() -> None:
    """Forget the plugins that checks have built and no run has taken."""
    _kept.clear()


def options_in(node: DictConfig, path: str) -> dict[str, Any]:
    """Read the options of a plugin from its config node; a UserError if one does not fit its type or bounds."""
    plugin = plugin_of(node)
    typed: DictConfig = OmegaConf.structured(plugin.config)
    try:
        typed.merge_with(literal(OmegaConf.to_container(node, resolve=True)))  # a worker's types are copies of ours
        options: Any = OmegaConf.to_container(typed, resolve=True, throw_on_missing=True)
    except MissingMandatoryValue as error:
        missing = f"{path}.{error.full_key}"
        raise UserError(
            f"{plugin.family}={plugin.name} needs {missing}, which has no default; type {missing}=..."
        ) from error
    except OmegaConfBaseException as error:
        reason = " ".join(str(error).split())
        raise UserError(f"{plugin.family}={plugin.name} does not take these options: {reason}") from error
    del options["_target_"]
    if hidden := _hidden_key(options):
        raise UserError(f"{path} has an option {hidden}; nothing below a plugin is built: drop that key")
    plugin.check(path, options)
    return options


def literal(data: Any) -> Any:
    """Write the texts of nested data so that OmegaConf, when it resolves them once, reads no interpolation in them."""
    if isinstance(data, str):
        return re.sub(r"(\\*)\$\{", r"\1\1\\${", data)
    if isinstance(data, dict):
        return {key: literal(value) for key, value in data.items()}
    return [literal(value) for value in data] if isinstance(data, list) else data


def _hidden_key(data: Any) -> str:
    """Find the first key that begins with ``_``, as those do by which Hydra finds code; "" if there is none."""
    if isinstance(data, dict):
        own = (key for key in data if str(key).startswith("_"))
        return str(next(own, "")) or _hidden_key(list(data.values()))
    return next(filter(None, map(_hidden_key, data)), "") if isinstance(data, list) else ""


def build_named(family: str, name: str, options: dict[str, Any], *runtime: object) -> Any:
    """Build ``family=name`` with options read from a file: registered classes and their keys only (UserError)."""
    plugin = _plugins.get((family, name))
    if plugin is None:
        choices = ", ".join(p.name for p in plugins(family))
        raise UserError(
            f"{family}={in_short(name)} is not among the plugins here ({choices}); add the file that defines it"
        )
    return build(plain_config(options | {"_target_": plugin.target}), *runtime)


def plain_config(values: dict[str, Any]) -> DictConfig:
    """Turn values from a file into a config; an interpolation, which could read other data, is a UserError."""
    if "${" in json.dumps(check_plain(values)):
        raise UserError("a config from a file holds an interpolation, ${...}; write the value instead")
    config: DictConfig = OmegaConf.create(values)
    return config
