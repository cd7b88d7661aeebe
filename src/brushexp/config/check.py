"""Check the names, types, bounds, plugins and rules of a composed config before a run starts."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, get_args, get_origin

from omegaconf import DictConfig, ListConfig, OmegaConf

from brushexp.bounds import Bounds
from brushexp.config.key_types import without_null
from brushexp.config.keys import Key, groups_of, keys_of
from brushexp.config.schema import Task
from brushexp.config.tasks import TASKS, task_for
from brushexp.config.vocabulary import plain, plain_name, spellings, with_words_of_changes
from brushexp.config.words import as_typed
from brushexp.errors import UserError, similar_words
from brushexp.registry import FAMILIES, MULTI_SELECT, Plugin, keep_built, options_in, plugin_of, plugins
from brushexp.system.words import table_of_words

MOST_OWNERS = 3  # largest number of options in a message that have the same name
SCALED_BY = {  # keys whose look values are scaled by another key: that key and its power
    "steps": ("effort", 1),
    "pixels_per_stroke": ("detail", -1),
    "max_strokes": ("detail", 1),
}
COLLECTIONS: dict[Any, tuple[type, str, str]] = {
    list: (ListConfig, "list", "[a,b]"),
    dict: (DictConfig, "mapping", "{a:b}"),
}
ELEMENTS = {str: "text", int: "a whole number", float: "a number"}
NOT_KEYS = {"task", "hydra", "experiment"}  # names at the top of a config that are neither keys nor groups
STYLE_PARTS = {"style.loss": "style.image", "style.strokes": "style.brushwork"}  # losses and the keys that add them


def check_stand_ins(name: str, values: Mapping[str, Any]) -> None:
    """Raise a UserError if the values require a different task."""
    if (other := task_for(name, values)) != name:
        raise UserError(f"task={other} handles this, not task={name}; repeat the command with task={other}")


def check(cfg: DictConfig, overrides: Sequence[str] = ()) -> None:
    """Check a composed config; errors name the override to correct. Plugins built here are kept for the run."""
    schema = TASKS[cfg.task]
    check_stand_ins(cfg.task, cfg)
    for family in MULTI_SELECT:
        if {f"+{family}", family} <= {override.partition("=")[0] for override in overrides}:
            raise UserError(f"Hydra ignores +{family}=... beside {family}=; type one list: '{family}=[a,b]'")
    check_names(cfg)
    check_chosen(cfg)
    for name, key in keys_of(schema).items():
        value = OmegaConf.select(cfg, name)
        if value is None and OmegaConf.is_missing(cfg, name):
            raise UserError(f"task={cfg.task} needs {name}: {key.meaning}; add {name}=...")
        check_collection(name, key.annotation, value)
        try:
            key.bounds.check(name, OmegaConf.to_object(value) if isinstance(value, ListConfig) else value, key.default)
        except UserError as error:
            raise UserError(name_scaling_key(cfg, key) or str(error)) from error
    for path, node in nodes_of(cfg):
        for option in set(node) - {"_target_", *plugin_of(node).meanings}:
            raise UserError(unknown_option(str(option), plugin_of(node), overrides))
        is_used = path not in STYLE_PARTS or OmegaConf.select(cfg, STYLE_PARTS[path]) is not None
        try:
            check_plugin(path, node, is_used)
        except UserError as error:
            raise UserError(with_words_of_changes(str(error))) from error
    if cfg.get("resume") is None:  # otherwise the settings of the continued run apply
        schema.check(cfg, overrides)


def name_scaling_key(cfg: DictConfig, key: Key) -> str:
    """Explain which key scales the value of ``key`` beyond its bounds, and suggest a value; return "" if none does."""
    scaling, power = SCALED_BY.get(key.name, ("", 0))
    if not power or not OmegaConf.is_interpolation(cfg, key.name) or not isinstance(key.bounds, Bounds):
        return ""
    value, factor = cfg[key.name], cfg[scaling]
    limit = min(max(value, key.bounds.low), key.bounds.high)
    wanted = factor * (limit / value) ** power if value > 0 else 1.0
    digit = 10.0 ** math.floor(math.log10(wanted))
    rounded = (math.floor if wanted < factor else math.ceil)(wanted / digit) * digit
    side = "at most" if value > limit else "at least"
    return f"{scaling}={factor:g} makes {key.name} {value:g}, which is not {side} {limit:g}; try {scaling}={rounded:g}"


def check_collection(name: str, annotation: Any, value: Any) -> None:
    """Raise a UserError for a value that is not a list or mapping of the annotated type.

    OmegaConf checks values with declared types, but not the values of interpolations such as ``${seed}``.
    """
    kind = without_null(annotation)
    if get_origin(kind) not in COLLECTIONS or (value is None and kind != annotation):
        return
    collection, noun, example = COLLECTIONS[get_origin(kind)]
    element = without_null(get_args(kind)[-1])
    if not isinstance(value, collection):
        raise UserError(f"{name} resolves to {as_typed(value)}, which is not a {noun}; type '{name}={example}'")
    elements: Any = value.values() if isinstance(value, DictConfig) else value
    accepted = (int, float) if element is float else element
    wrong = [one for one in elements if element in ELEMENTS and not isinstance(one, accepted)]
    if wrong:
        raise UserError(f"{name} holds {wrong[0]}, which is not {ELEMENTS[element]}; type '{name}={example}'")


def check_names(cfg: DictConfig) -> None:
    """Raise a UserError for keys, at any level, that the task does not have."""
    schema = TASKS[cfg.task]
    names = {*keys_of(schema), *groups_of(schema), *NOT_KEYS, *(group.rpartition("@")[2] for group in schema.groups)}
    parents = {name.rpartition(".")[0] for name in names}
    for parent in sorted(parents):
        for name in map(str, cfg[parent] if parent else cfg):
            path = f"{parent}.{name}" if parent else name
            if path not in names | parents:
                raise UserError(unknown_key(path, cfg.task))


def check_plugin(path: str, node: DictConfig, is_used: bool) -> None:
    """Check the options in a plugin's config node; if the run uses the plugin, build it and keep it."""
    options = options_in(node, path)
    try:
        if is_used:
            keep_built(node)
    except UserError as error:
        subject = re.split(r"\W", str(error), maxsplit=1)[0]  # some options cannot check the values typed before them
        raise UserError(f"{path}.{error}" if subject in options else str(error)) from error


def leaves(settings: Any, above: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the full key and the value of each leaf of nested settings."""
    settings = dict(enumerate(settings)) if isinstance(settings, list) else settings
    if not isinstance(settings, dict):
        yield above, settings
        return
    for key, value in settings.items():
        yield from leaves(value, f"{above}.{key}".lstrip("."))


def check_chosen(cfg: DictConfig) -> None:
    """Raise a UserError for a family without a chosen member, and for options of a plugin that is not chosen."""
    for family, default in TASKS[cfg.task].groups.items():
        if isinstance(default, str) and family in FAMILIES and "_target_" not in (cfg.get(family) or {}):
            raise UserError(f"{family} is not chosen; choose one of {members_of(family)}")
    for family in [family for family in MULTI_SELECT if family in cfg]:
        for name, node in cfg[family].items():
            if not isinstance(node, DictConfig):
                cure = f"type {family}.<name>.{name}={node}; a preset of one begins with 'defaults: [<name>]'"
                cure += f" (there are: {members_of(family)})"
                if options := [", ".join(one.meanings) for one in plugins(family) if one.name == name]:
                    cure = f"type {family}.{name}.<option>={node}, one of {options[0]}"
                raise UserError(f"{family}.{name}={node} is not an option of any {family}; {cure}")
        chosen = [name for name, node in cfg[family].items() if "_target_" in node]
        tuned = [name for name in cfg[family] if name not in chosen]
        if tuned:
            names = ",".join([*chosen, *tuned])
            wrong = f"{family}.{tuned[0]} has options but is not chosen (chosen: {', '.join(chosen) or 'none'})"
            raise UserError(f"{wrong}; add it with '{family}=[{names}]' or drop the keys below {family}.{tuned[0]}")
        if family == "loss" and not chosen:
            cure = f"try loss=mse (there are: {members_of(family)})"
            raise UserError(f"no loss is chosen, so nothing can be optimised; {cure}")
        if family == "to" and not chosen:
            raise UserError(f"to=[] writes nothing; choose one or more of {members_of(family)}")


def nodes_of(cfg: DictConfig, above: str = "") -> Iterator[tuple[str, DictConfig]]:
    """Yield the key and the node of each chosen plugin."""
    for name, node in ((str(key), node) for key, node in cfg.items()):
        if isinstance(node, DictConfig) and (above or name in FAMILIES or name == "style"):
            if "_target_" in node:
                yield f"{above}{name}", node
            else:
                yield from nodes_of(node, f"{above}{name}.")


def members_of(family: str) -> str:
    """List the members of a family for an error message."""
    return ", ".join(plugin.name for plugin in plugins(family))


def meant_by(word: str, names: Sequence[str]) -> list[str]:
    """List up to three names that a word may stand for: synonyms, names with this last part, and similar names."""
    plain = plain_name(word)
    ours = [name for name in (spellings("keys").get(plain, ""), spellings("members").get(plain, "")) if name in names]
    parts = [name for name in names if name.rpartition(".")[2] == plain]
    return [*dict.fromkeys([*ours, *parts, *similar_words(word, names)])][:3]


def cure_for(word: str, names: Sequence[str], listing: str) -> str:
    """Say, for an error message, which names a word may stand for, and which command lists all names."""
    meant = meant_by(word, names)
    return f"did you mean {' or '.join(meant)}? (see all: {listing})" if meant else f"see all: {listing}"


def listing_of(group: str, name: str = "") -> str:
    """Return the command that lists the members of a group, and the options of a member if ``name`` is given."""
    topics = {"task": "--help=tasks", "experiment": "--help=research"}
    return f"brushexp {topics.get(group, f'{group}={name} --help' if name else f'{group} --help')}"


def listing_of_keys(task: str) -> str:
    """Return the command that lists the keys of a task."""
    return "brushexp --help=all" if task == "paint" else f"brushexp {task} --help"


def unknown_option(option: str, plugin: Plugin, arguments: Sequence[str] = ()) -> str:
    """Explain that a plugin lacks an option, and name the plugins that have it, starting with those the user named."""
    family, names = plugin.family, list(plugin.meanings)
    text = f"{plugin.path}.{option} is not an option of {family}={plugin.name}; "
    text += cure_for(option, names, listing_of(family, plugin.name)) if names else "it has none"
    owners = [other.name for other in plugins(family) if option in other.meanings]
    typed = " ".join(word for word in arguments if word.startswith(f"{family}="))
    owners.sort(key=lambda name: re.search(rf"\b{name}\b", typed) is None)
    if arguments and not any(f"{plugin.path}.{option}" in word for word in arguments):
        choices = " or ".join(f"{family}={name}" for name in owners)
        return f"{family}={plugin.name} has no {option}, which this task sets; choose {choices}"
    if owners and family not in MULTI_SELECT:
        text += f". It is one of {', '.join(f'{family}={name}' for name in owners)}; a sweep over both: "
        text += f"-m \"hydra.sweeper.settings=['{family}={plugin.name}','{family}={owners[0]} {family}.{option}=...']\""
    return text


def change_words_of(schema: type[Task]) -> dict[str, str]:
    """Map the short words that a task accepts to the options of changes that they set."""
    taken = table_of_words("change_words") if "change" in schema.groups else {}
    return {word: option for word, option in taken.items() if word not in keys_of(schema)}


def meaning_of_option(option: str) -> str:
    """Return the description of a plugin option such as ``change.wet.amount``, or "" if the option does not exist."""
    above, _, name = option.rpartition(".")
    return next((plain(plugin.meanings.get(name, "")) for plugin in plugins() if plugin.path == above), "")


def explain_foreign_key(typed: str, task: str) -> str:
    """Explain an unknown key by naming its equivalent in this program; return "" if there is no equivalent."""
    schema, plain = TASKS[task], plain_name(typed)
    keys, words = keys_of(schema), change_words_of(schema)
    if typed in words:
        return f"{typed} works on the command line only; in a file, set {words[typed]}"
    if (meant := spellings("keys").get(plain, "")) in {*keys, *words}:
        meaning = keys[meant].meaning if meant in keys else meaning_of_option(words[meant])
        return f"{typed} is not a key of task={task}; type {meant}=... ({meaning})"
    names = [*keys, *groups_of(schema), *words]
    cure = spellings("instead").get(plain, "")
    if cure.split("=")[0].lstrip("+") in names or cure.startswith(("brushexp ", "task=")):
        return f"{typed} is not a key of task={task}; type {cure}"
    return ""


def unknown_key(typed: str, task: str) -> str:
    """Explain that a task lacks a key or, for a plugin's option, that the plugin is not chosen."""
    family, _, rest = typed.partition(".")
    keys, plain = keys_of(TASKS[task]), plain_name(typed)
    names = [*keys, *change_words_of(TASKS[task]), *groups_of(TASKS[task])]
    if known := explain_foreign_key(typed, task):
        return known
    if family in MULTI_SELECT and rest:
        name, members = rest.partition(".")[0], [plugin.name for plugin in plugins(family)]
        owners = [f"{plugin.path}.{name}" for plugin in plugins(family) if name in plugin.meanings]
        if name not in members and owners:
            return f"{typed} is not a key but an option of one {family}; type {' or '.join(owners[:MOST_OWNERS])}"
        mend = f"add {name} to the list, '{family}=[{name},...]', or drop the keys below it"
        if name not in members:
            mend = (
                f"{cure_for(name, members, listing_of(family))}; options go below a member, {family}.<name>.{name}=..."
            )
        return f"{family}.{name} has options but is not chosen; {mend}"
    for plugin in plugins():
        for option in plugin.meanings:
            if typed.startswith(f"{plugin.path}.{option}."):
                return f"{typed} does not exist yet; to add it to {plugin.path}.{option}, type a plus: '+{typed}=...'"
    above = typed.rpartition(".")[0]
    beside = [name for name in names if name.rpartition(".")[0] == above or name.endswith(f".{plain}")] or names
    near = cure_for(typed, beside, listing_of_keys(task))
    name = spellings("keys").get(plain, typed)
    owners = [f"{plugin.path}.{name}" for plugin in plugins() if name in plugin.meanings and plugin.family in names]
    if owners:
        near = f"type {' or '.join([*dict.fromkeys(map(with_words_of_changes, owners))][:MOST_OWNERS])}"
    text = f"{typed} is not a key of task={task}; {near}"
    others = [
        f"task={name}"
        for name, schema in sorted(TASKS.items())
        if any(f"{key}.".startswith(f"{typed}.") for key in (*keys_of(schema), *groups_of(schema)))
    ]
    return text + (f". It is one of {', '.join(others)}" if others else "")
