"""Register classes as typed command-line choices; find, build and check plugins."""

from brushexp.registry.building import (
    build,
    build_named,
    drop_built,
    family_of_key,
    keep_built,
    literal,
    name_of_target,
    options_in,
    plain_config,
    plugin_of,
    take_built,
)
from brushexp.registry.families import FAMILIES, FOLDERS, MULTI_SELECT, SEARCH_PATH
from brushexp.registry.plugin import Plugin, loaded_plugins, member, plugin_of_class, plugins, register

__all__ = [
    "FAMILIES",
    "FOLDERS",
    "MULTI_SELECT",
    "SEARCH_PATH",
    "Plugin",
    "build",
    "build_named",
    "drop_built",
    "family_of_key",
    "keep_built",
    "literal",
    "loaded_plugins",
    "member",
    "name_of_target",
    "options_in",
    "plain_config",
    "plugin_of",
    "plugin_of_class",
    "plugins",
    "register",
    "take_built",
]
