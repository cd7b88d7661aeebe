"""Turn classes into command-line choices: ``@register("loss", "mse")`` defines ``loss=mse``.

A plugin is *announced* by family and name, which is enough to list it. Its module is imported only when its options,
its help text or an instance is needed.
"""

import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cache, cached_property, partial
from typing import Any, TypeVar

from omegaconf import DictConfig, OmegaConf

from brushexp.bounds import ANY, Bounds, Rule, bounds_of
from brushexp.compat.hydra import remove_choice, store_when_read
from brushexp.errors import UserError
from brushexp.registry.families import CORE, FAMILIES, FOLDERS, MULTI_SELECT
from brushexp.registry.options import options_of, structured_config
from brushexp.registry.sources import note_source
from brushexp.system.published import entry_points_of

ENTRY_POINTS = "brushexp.plugins"  # entry-point group: "family.name" -> module that defines the class
DISTRIBUTION = "brushexp"  # distribution whose entry points are ours

C = TypeVar("C", bound=type)


@dataclass(frozen=True)
class Plugin:
    """A class that users choose with ``family=name``, and its options."""

    family: str
    name: str
    module: str  # module that defines the class, or a package that contains it
    source: str  # source for messages: a file or an entry point
    load: Callable[[], object]  # imports the module
    is_ours: bool  # whether it ships with the program; results of other plugins are checked

    @cached_property
    def cls(self) -> type:
        """Return the plugin's class; raise a UserError if its module cannot be imported or does not register it."""
        if (self.family, self.name) not in _classes:
            import_or_explain(self.load, self.source)
        if (self.family, self.name) not in _classes:
            cure = f'decorate its class with @register("{self.family}", "{self.name}")'
            raise UserError(f"{self.source} defines no {self.family}={self.name}; {cure}")
        return _classes[self.family, self.name]

    @property
    def is_loaded(self) -> bool:
        return (self.family, self.name) in _classes

    @property
    def target(self) -> str:
        """Return the value of ``_target_`` in configs, which stays valid if the class moves to another module."""
        return f"{self.family}/{self.name}"

    @property
    def path(self) -> str:
        """Return the config key that holds the plugin's options."""
        return f"{self.family}.{self.name}" if self.family in MULTI_SELECT else self.family

    @cached_property
    def config(self) -> type:
        """Return the dataclass of the plugin's options."""
        return structured_config(self.cls, self.target)

    @cached_property
    def bounds(self) -> dict[str, Bounds | Rule]:
        """Return the bounds of each option."""
        return {name: bounds_of(annotation) or ANY for name, annotation, _ in options_of(self.cls)}

    @property
    def summary(self) -> str:
        return (inspect.getdoc(self.cls) or "").partition("\n")[0]

    @property
    def meanings(self) -> dict[str, str]:
        """Return each option's description from ``Args:`` in the docstrings of the class and its bases."""
        texts: dict[str, str] = {}
        for cls in reversed(self.cls.__mro__):
            section = inspect.cleandoc(cls.__doc__ or "").partition("\nArgs:\n")[2].partition("\n\n")[0]
            entries = re.findall(r"^    (\w+): (.*(?:\n     .*)*)", section, re.MULTILINE)
            texts |= {name: " ".join(text.split()) for name, text in entries}
        return {item.name: texts.get(item.name, "") for item in fields(self.config) if item.name != "_target_"}

    @property
    def facts(self) -> dict[str, str]:
        """Return named facts that help users choose between the members of a family."""
        return dict(getattr(self.cls, "facts", dict)())

    def check(self, path: str, options: Mapping[str, Any]) -> None:
        """Raise a UserError if an option is out of bounds; ``path`` is the config key that holds the options."""
        for option, bounds in self.bounds.items():
            value = options[option]
            plain = OmegaConf.to_object(value) if OmegaConf.is_config(value) else value
            bounds.check(f"{path}.{option}", plain, self._defaults.get(option))

    @cached_property
    def _defaults(self) -> dict[str, Any]:
        node: DictConfig = OmegaConf.structured(self.config)
        return {str(option): node[option] for option in node if not OmegaConf.is_missing(node, option)}


_members: dict[tuple[str, str], Plugin] = {}  # announced plugins by family and name
_classes: dict[tuple[str, str], type] = {}  # plugins whose modules are imported


def announce(plugin: Plugin) -> None:
    """Add a plugin to the Hydra group of its family; raise a UserError if another module has taken the name.

    The plugin's config is built when Hydra reads it.
    """
    check_family(plugin.family)
    key = plugin.family, plugin.name
    is_new = key not in _members
    if not is_new and _members[key].module != plugin.module:
        taken = f"{plugin.family}={plugin.name} is taken by {_members[key].module}"
        raise UserError(f"{taken}; give the one in {plugin.module} another name")
    _members[key] = plugin
    if is_new:  # otherwise Hydra has it already, perhaps with options of looks around it
        # A worker process of a sweep inherits a filled store and stores the same node again, which is not a clash.
        store_when_read(plugin.family, plugin.name, partial(_config_of, *key), plugin.module, package=plugin.path)


def withdraw(module: str) -> None:
    """Remove the plugins that a module registered before it failed to import."""
    for family, name in [key for key, plugin in _members.items() if plugin.module == module]:
        del _members[family, name]
        _classes.pop((family, name), None)
        remove_choice(family, name)


def is_ours(module: str) -> bool:
    """Return whether a module ships with brushexp, in the core or in one of its packages."""
    return module.startswith(CORE) or module.partition(".")[0] in _our_packages()


@cache
def _our_packages() -> set[str]:
    """Return the import names of the packages that ship with brushexp."""
    points = entry_points_of(ENTRY_POINTS).values()
    return {point.module.partition(".")[0] for point in points if point.dist and point.dist.name == DISTRIBUTION}


def check_family(family: str) -> None:
    """Raise a UserError if the family is unknown."""
    if family not in FAMILIES:
        raise UserError(f"unknown plugin family {family!r}; choose one of {', '.join(FAMILIES)}")


def _config_of(family: str, name: str) -> DictConfig:
    config: DictConfig = OmegaConf.structured(_members[family, name].config)
    return config


def register(family: str, name: str) -> Callable[[C], C]:
    """Register the decorated class as the Hydra choice ``family=name``; raise a UserError if the name is taken.

    >>> from brushexp.registry import build_named, plugins
    >>> "area" in [plugin.name for plugin in plugins("order")]  # published by the decorator
    True
    >>> build_named("order", "area", {"every": 5}).every
    5
    """
    check_family(family)

    def publish(cls: C) -> C:
        if not isinstance(cls, type):
            raise UserError(f"{family}={name} is {cls!r}, not a class; write one, as docs/tutorial.md shows")
        module, known = cls.__module__, _members.get((family, name))
        if known is not None and f"{module}.".startswith(f"{known.module}."):
            plugin = replace(known)  # options may have changed in a module that is imported again
        else:
            plugin = Plugin(family, name, module, module, lambda: None, is_ours(module))
        announce(plugin)
        if not plugin.is_ours:
            from brushexp.registry.results import check_results  # noqa: PLC0415  (torch, which --help does not need)

            check_results(family, name, cls, f"{CORE}plugins.{FOLDERS[family]}.base")
        _classes[family, name] = cls
        if not plugin.is_ours:
            note_source(cls)
            OmegaConf.structured(plugin.config)  # refuses an option without a type immediately
        return cls

    return publish


def plugins(family: str | None = None) -> list[Plugin]:
    """Return the plugins of one family, or of all families if None, sorted by family and name."""
    chosen = [plugin for plugin in _members.values() if family in (None, plugin.family)]
    return sorted(chosen, key=lambda plugin: (list(FAMILIES).index(plugin.family), plugin.name))


def loaded_plugins() -> list[Plugin]:
    """Return the plugins whose modules have been imported."""
    return [plugin for plugin in plugins() if plugin.is_loaded]


def member(family: str, name: str) -> Plugin | None:
    """Return the plugin with this family and name, or None if there is none."""
    return _members.get((family, name))


def plugin_of_class(cls: type) -> Plugin | None:
    """Return the plugin that a class defines, or None if the class is not registered."""
    return next((_members[key] for key, registered in _classes.items() if registered is cls), None)


def import_or_explain(load: Callable[[], Any], source: str) -> Any:
    """Call ``load``; if it fails, raise a UserError that explains why the plugin at ``source`` cannot be loaded."""
    try:
        return load()
    except UserError as error:
        raise UserError(f"plugin {source}: {error}") from error
    except SyntaxError as error:
        raise UserError(f"plugin {source}, line {error.lineno}: {error.msg}; correct it or move it away") from error
    except (Exception, SystemExit) as error:
        reason = f"{type(error).__name__}: {' '.join(str(error).split())}"
        raise UserError(f"plugin {source} cannot be loaded: {reason}; correct it or move it away") from error
