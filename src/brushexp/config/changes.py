"""Expand short words for options of changes: ``guides=lines.png`` chooses a change and sets one of its options.

guides=lines.png                +change=[guides] change.guides.lines=lines.png
guides=lines.png change=[wet]   change=[wet,guides] change.guides.lines=lines.png
tubes=zorn mixtures=5           look=tubes +metric=[ciede2000] change.tubes.tubes=zorn change.tubes.mixtures=5
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from hydra.core.config_store import ConfigStore
from omegaconf import DictConfig

from brushexp.config.keys import keys_of
from brushexp.config.looks import choices_of, is_tuned
from brushexp.config.schema import PaintTask
from brushexp.config.tasks import TASKS
from brushexp.config.vocabulary import spellings
from brushexp.errors import UserError
from brushexp.system.words import table_of_words

GROUP = "change"
LIST = re.compile(r"\[?([\w\s,]*)\]?")  # list of names
NONE = ("", "null", "none")  # values of a word that choose no change


def expand_changes(words: Sequence[str], beside: Sequence[str] = (), *, sweep: bool = False) -> list[str]:
    """Expand the command-line words that set options of changes; ``beside`` contains the other arguments in effect.

    Raises a UserError that names a word from an earlier version, or a word whose change is not chosen.
    """
    refuse_earlier(words)
    schema = TASKS.get(value_of("task", [*beside, *words]), PaintTask)
    if GROUP not in schema.groups:
        return [*words]
    keys = keys_of(schema)
    stands_for = {word: path for word, path in table_of_words("change_words").items() if word not in keys}
    tunes = {word: paths for word, paths in table_of_words("change_options").items() if word not in keys}
    meant = [path_of(stands_for[key])[0] for key, value in pairs_in(words) if key in stands_for and value not in NONE]
    brought = [word for name in dict.fromkeys(meant) for word in table_of_words("brings").get(name, ())]
    words = [*words, *unset_words(brought, [*beside, *words])]
    by_words, by_looks = chosen_changes([*beside, *words])
    present = {*meant, *by_words}.union(*by_looks)
    expanded = []
    for word in words:
        key, equal, value = word.partition("=")
        if key in stands_for and equal:
            is_left_out = value in NONE and path_of(stands_for[key])[0] not in present
            expanded += [] if is_left_out else [f"{stands_for[key]}={value}"]
        elif key in tunes and equal:
            paths = [path for path in tunes[key] if path_of(path)[0] in present]
            if not paths:
                raise UserError(f"{key}={value} {needs(key)}")
            expanded += [f"{path}={value}" for path in paths]
        else:
            expanded.append(word)
    has_list = any(word.startswith(f"{GROUP}=") for word in [*beside, *words])
    there = by_words if has_list else by_words.union(set.intersection(*by_looks))
    added = [name for name in dict.fromkeys(meant) if name not in there]
    if any(is_tuned(GROUP, name) for name in added) and not has_list:
        expanded = with_list_of_look(expanded, beside)
    return choose(expanded, added, sweep=sweep)


def with_list_of_look(words: Sequence[str], beside: Sequence[str]) -> list[str]:
    """Add the look's list of changes to the arguments, unless they name several looks or a study, or use ``+change``.

    Hydra composes members that are added by ``+change`` before it composes the look, but the options of some members
    depend on the look.
    """
    every = [*beside, *words]
    look = value_of("look", every) or PaintTask.presets["look"]
    if "," in look or any(word.startswith(("experiment=", f"+{GROUP}=")) for word in every):
        return [*words]
    return [*words, f"{GROUP}=[{','.join(changes_of(look))}]"]


def choose(words: Sequence[str], names: Sequence[str], *, sweep: bool = False) -> list[str]:
    """Add members to the list of changes on the command line or, if there is none, to the look's list."""
    if not names:
        return [*words]
    typed = [word for word in words if word.startswith((f"{GROUP}=", f"+{GROUP}="))]
    if not typed:
        return [*words, f"+{GROUP}=[{','.join(names)}]"]
    key, _, value = typed[-1].partition("=")
    if not LIST.fullmatch(value) or (sweep and "," in value and not value.startswith("[")):
        cure = f"add {' and '.join(names)} to each of its lists"
        raise UserError(f"cannot add {' and '.join(names)} to the sweep {typed[-1]}; {cure}")
    whole = f"{key}=[{','.join(dict.fromkeys([*names_in(typed[-1]), *names]))}]"
    return [whole if word == typed[-1] else word for word in words]


def merge(words: Iterable[str]) -> list[str]:
    """Merge all arguments that choose changes, such as those of a sweep and those of its settings, into one list."""
    words = [*words]
    lists = [word for word in words if word.startswith((f"{GROUP}=", f"+{GROUP}="))]
    if len(lists) < 2:
        return words
    first = next((word for word in lists if not word.startswith("+")), lists[0])
    others = [name for word in lists if word != first for name in names_in(word)]
    return choose([word for word in words if word == first or word not in lists], others)


def keep_added(words: Sequence[str], beside: Iterable[str]) -> list[str]:
    """Add changes from the other arguments, ``beside``, to a setting's own list, which would otherwise replace them."""
    added = [name for word in beside if word.startswith(f"+{GROUP}=") for name in names_in(word)]
    has_list = any(word.startswith((f"{GROUP}=", f"+{GROUP}=")) for word in words)
    return choose(words, added) if has_list else [*words]


def names_in(word: str) -> list[str]:
    """List the changes that an argument names; the list is empty if the argument defines a sweep."""
    found = LIST.fullmatch(word.partition("=")[2])
    return re.findall(r"\w+", found[1]) if found else []


def chosen_changes(words: Sequence[str]) -> tuple[set[str], list[set[str]]]:
    """Return the changes that arguments choose directly, and the changes chosen by each look that they name."""
    looks = (value_of("look", words) or PaintTask.presets["look"]).split(",")
    typed = [word for word in words if word.startswith((f"{GROUP}=", f"+{GROUP}="))]
    return {name for word in typed for name in names_in(word)}, [{*changes_of(look)} for look in looks]


def changes_of(look: str) -> list[str]:
    """List the changes that a look chooses, or the task's changes if the look chooses none."""
    stored = ConfigStore.instance().repo.get("look", {}).get(f"{look}.yaml")
    look_node: Any = {} if stored is None else stored.node
    return [*choices_of(look_node, PaintTask.groups)[GROUP]]


def unset_words(brought: Iterable[str], words: Sequence[str]) -> list[str]:
    """List the implied arguments, ``brought``, whose keys the user has not set."""
    typed = {key.lstrip("+~") for key, _ in pairs_in(words)}
    return [word for word in brought if word.partition("=")[0].lstrip("+") not in typed]


def refuse_earlier(words: Sequence[str]) -> None:
    """Raise a UserError for callbacks and tasks that have become changes since an earlier version."""
    for key, value in pairs_in(words):
        for name in re.findall(r"\w+", value) if key in ("task", "callbacks", "+callbacks") else ():
            if cure := table_of_words("earlier").get(f"{key.lstrip('+')}={name}"):
                is_resumed = key == "task" and value_of("resume", words)
                raise UserError(f"{key}={name} has become a change; {'drop it' if is_resumed else f'type {cure}'}")


def needs(word: str) -> str:
    """Explain which words choose the change that an option word belongs to."""
    names = [path_of(path)[0] for path in table_of_words("change_options")[word]]
    choosing = [key for key, path in table_of_words("change_words").items() if path_of(path)[0] in names]
    other = spellings("keys").get(word)
    cure = f"type {other}=..." if other else f"drop {word}"
    return f"is for {' or '.join(f'{key}=' for key in choosing)}; add {choosing[0]}=..., or {cure}"


def pairs_in(words: Iterable[str]) -> list[tuple[str, str]]:
    """List the key and value of each word of the form ``key=value``."""
    return [(key, value) for key, equal, value in (word.partition("=") for word in words) if equal]


def value_of(key: str, words: Iterable[str]) -> str:
    """Return the last value given for a key, or "" if there is none."""
    return next((value for name, value in reversed(pairs_in(words)) if name == key), "")


def path_of(option: str) -> tuple[str, str]:
    """Split an option path such as ``change.wet.amount`` into the names of the change and of the option."""
    _, name, option = option.split(".")
    return name, option


def as_typed_word(name: str, node: Mapping[str, Any] | DictConfig) -> str:
    """Write a chosen change as its short word, ``wet=0.5``, or, if it has none, as ``change=random_ground``."""
    for word, path in table_of_words("change_words").items():
        change, option = path_of(path)
        if change == name and node.get(option) is not None:
            return f"{word}={node[option]}"
    return f"{GROUP}={name}"


def shorten_words(words: Iterable[str]) -> list[str]:
    """Shorten expanded arguments to those that a user would type.

    >>> shorten_words(["image=a.png", "+change=[guides]", "change.guides.lines=b.png"])
    ['image=a.png', 'guides=b.png']
    """
    words = [*words]
    named = {path: word for word, path in table_of_words("change_words").items()}
    named |= {path: word for word, paths in table_of_words("change_options").items() for path in paths}
    chosen = {path_of(key)[0] for key, _ in pairs_in(words) if key in table_of_words("change_words").values()}
    brought = {word for name in chosen for word in table_of_words("brings").get(name, ())}
    short = []
    for word in words:
        key, _, value = word.partition("=")
        if word in brought or (key == f"+{GROUP}" and {*names_in(word)} <= chosen):
            continue
        short.append(f"{named[key]}={value}" if key in named and path_of(key)[0] in chosen else word)
    return [*dict.fromkeys(short)]
