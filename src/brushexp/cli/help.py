"""Compose the output of ``--help``."""

from collections.abc import Iterator, Sequence
from functools import reduce
from itertools import chain
from operator import getitem
from pathlib import Path
from textwrap import fill
from typing import Any

from omegaconf import DictConfig, OmegaConf

from brushexp.config.check import change_words_of
from brushexp.config.compose import CHOSEN_GROUPS, presets_of
from brushexp.config.keys import Key, groups_of, keys_of
from brushexp.config.output_folders import BESIDE_PAINTING, BY_TIME
from brushexp.config.schema import PaintTask
from brushexp.config.tasks import TASKS
from brushexp.config.vocabulary import is_path, plain
from brushexp.config.words import as_typed
from brushexp.errors import UserError
from brushexp.pictures.load import samples
from brushexp.registry import FAMILIES, MULTI_SELECT, plugins
from brushexp.system.words import table_of_words

TITLE = "Paint pictures out of brush strokes by gradient descent, and study how well that works."
TOPICS = {  # --help=topic
    "all": "every key and plugin of a task",
    "tasks": "all other tasks",
    "research": "tasks and studies for researchers: training, benchmarks, evidence",
}
PRESETS = {  # groups of presets, which set several keys
    "look": "medium or style of a painting",
    "quality": "number of strokes and steps, against time",
    "trainer": "options of Lightning's Trainer",
    "experiment": "named study",
}
UNTYPED = {BY_TIME: "outputs/DATE_TIME", BESIDE_PAINTING: "outputs/x"}  # default values as the help shows them
PATHS = {"image": "photo.jpg", "catalogue": "outputs/x", "runs": "outputs"}  # example of the path that a task takes
MORE = "Documentation: README.md and docs/. --cfg job prints the whole config, --hydra-help lists Hydra's own flags."
LINE_WIDTH = 120  # characters per line
COLUMN = 28  # column at which meanings start
EXAMPLE_COLUMN = 52  # column at which explanations of examples start
TRAINER = "trainer."  # keys of Lightning's Trainer, which few people need


def words_and_topic(words: Sequence[str]) -> tuple[list[str], str]:
    """Separate the topic in ``--help=topic`` from a command line; it is "" if there is none.

    In a request for help, a family alone means its members: ``look --help`` and ``--help=look`` become
    ``look= --help``. Raises a UserError for an unknown topic.
    """
    topics = [word.removeprefix("--help=") for word in words if word.startswith("--help=")]
    plain_words = ["--help" if word.startswith("--help=") else word for word in words]
    if not {"--help", "-h"} & {*plain_words}:
        return plain_words, ""
    topic = topics[-1] if topics else ""
    plain_words = [f"{family}=" if (family := family_in(word)) else word for word in plain_words]
    if family := family_in(topic):
        return [*plain_words, f"{family}="], ""
    if topic and topic not in TOPICS:
        cure = f"type --help, or --help= and a family such as look, or one of {', '.join(TOPICS)}"
        raise UserError(f"--help={topic} is not a topic; {cure}")
    return plain_words, topic


def family_in(word: str) -> str:
    """Return the family that a word names, also in the plural, or "" if it names none or a file.

    >>> family_in("look"), family_in("looks"), family_in("coffee")
    ('look', 'look', '')
    """
    names = [name for name in (word, word.removesuffix("s")) if name in CHOSEN_GROUPS - {"task"}]
    return names[0] if names and not is_path(word) else ""


def help_text(cfg: DictConfig, overrides: Sequence[str], folders: Sequence[Path], topic: str = "") -> str:
    """Return the help text for a composed config and the user's overrides; ``folders`` contain the presets.

    If the user names a family, as in ``renderer=`` or ``renderer=neural``, the text lists the members of the family and
    the options of the chosen members.
    """
    typed = [word.lstrip("+~").partition("=")[0].partition(".")[0] for word in overrides]
    families = [name for name in dict.fromkeys(typed) if name in CHOSEN_GROUPS - {"task"}]
    if topic == "all":
        lines = _all_of(cfg, folders, families)
    elif topic:
        lines = _tasks_of(topic, folders)
    elif families:
        lines = [line for family in families for line in _group(family, cfg, folders, with_options=True)]
    elif cfg.task == "paint":
        lines = _start(cfg, folders)
    else:
        lines = _task(cfg, folders)
    return "\n".join(lines)


def _start(cfg: DictConfig, folders: Sequence[Path]) -> list[str]:
    """Compose the start page: examples, looks, qualities, the most useful keys, and further topics."""
    schema, lines = PaintTask, [TITLE, ""]
    examples = table_of_words("examples").items()
    for example, meaning in sorted(examples, key=lambda pair: not pair[0].startswith("brushexp photo.jpg")):
        lines += two_columns(example, meaning, EXAMPLE_COLUMN)
    for group, head in (("look", "Looks: look=plain, or just plain"), ("quality", "Qualities: quality=draft")):
        lines += ["", head, *_members(group, folders)]
    lines += ["", "Most useful keys, with their current values"]
    lines += _keys(cfg, [key for name, key in keys_of(schema).items() if name in schema.common])
    lines += ["", "More"]
    for topic, about in TOPICS.items():
        lines += two_columns(f"brushexp --help={topic}", about, EXAMPLE_COLUMN)
    families = ", ".join(family for family in FAMILIES if family in groups_of(schema) or family == "to")
    lines += two_columns("brushexp renderer --help", f"members and options of a family: {families}", EXAMPLE_COLUMN)
    lines += two_columns("brushexp export --help", "the keys of another task", EXAMPLE_COLUMN)
    lines += two_columns("brushexp doctor", "what is installed and what is broken, for a bug report", EXAMPLE_COLUMN)
    return [*lines, "", MORE]


def _task(cfg: DictConfig, folders: Sequence[Path]) -> list[str]:
    """Compose the help page of a task: its description, keys and plugins."""
    schema = TASKS[cfg.task]
    lines = [usage_of(cfg.task, schema.alone), plain(schema.__doc__ or ""), "", "Keys and their current values"]
    keys = keys_of(schema)
    lines += _keys(cfg, [key for name, key in keys.items() if not name.startswith(TRAINER)])
    if groups := [group for group in groups_of(schema) if _names(group, folders)]:
        lines += ["", "Plugins and presets; for details type, for example, brushexp renderer --help"]
        for group in groups:
            lines += two_columns(group, ", ".join(_names(group, folders)))
    more = f"brushexp {cfg.task} --help=all shows all of them" + (
        f", and the keys below {TRAINER[:-1]}" if any(name.startswith(TRAINER) for name in keys) else ""
    )
    return [*lines, "", f"{more}.", MORE]


def _all_of(cfg: DictConfig, folders: Sequence[Path], families: Sequence[str]) -> list[str]:
    """List every key of a task with its description, and every plugin and preset that the task can use."""
    schema = TASKS[cfg.task]
    lines = [usage_of(cfg.task, schema.alone), plain(schema.__doc__ or ""), "", "Keys and their current values"]
    lines += _keys(cfg, list(keys_of(schema).values()))
    lines += _words_of_changes(cfg)
    for group in groups_of(schema):
        lines += ["", *_group(group, cfg, folders, with_options=group in families)]
    if schema.alone == "image":
        lines += ["", *fill(f"Sample pictures: {', '.join(sorted(samples()))}", LINE_WIDTH).splitlines()]
    return [*lines, "", MORE]


def _tasks_of(topic: str, folders: Sequence[Path]) -> list[str]:
    """List the tasks of a topic, one per line; for the topic ``research``, also list the studies."""
    lines = [f"{TOPICS[topic].capitalize()}; the keys of each: brushexp NAME --help", ""]
    for name in TASKS:
        if TASKS[name].is_research == (topic == "research"):
            lines += two_columns(name, (TASKS[name].__doc__ or "").partition("\n")[0])
    return [*lines, "", "Studies: experiment=inits", *_members("experiment", folders)] if topic == "research" else lines


def _words_of_changes(cfg: DictConfig) -> list[str]:
    """List the short words for options of changes with their current values, which are null unless chosen."""
    words = change_words_of(TASKS[cfg.task])
    options = {option: word for word, option in words.items()}
    for word, tuned in table_of_words("change_options").items():
        options |= {option: word for option in tuned} if words else {}
    lines: dict[str, list[str]] = {}
    for plugin in plugins("change"):
        is_taken = cfg.task == "paint" or getattr(plugin.cls, "only_ends", False)
        for option, meaning in plugin.meanings.items() if is_taken else ():
            path = f"{plugin.path}.{option}"
            if path in options:
                head = f"{options[path]}={as_typed(OmegaConf.select(cfg, path))}"
                lines.setdefault(options[path], two_columns(head, meaning.rstrip(".")))
    about = "Changes to a painting; null = not chosen"
    return ["", about, *chain.from_iterable(lines.values())] if lines else []


def usage_of(task: str, alone: str) -> str:
    r"""Return the usage line of a task.

    >>> usage_of("export", "catalogue"), usage_of("paint", "image")
    ('brushexp export outputs/x [key=value ...]\n', 'brushexp photo.jpg [key=value ...]\n')
    """
    name = [] if task == "paint" else [task]
    return " ".join(["brushexp", *name, *([PATHS[alone]] if alone in PATHS else []), "[key=value ...]\n"])


def _keys(cfg: DictConfig, keys: Sequence[Key]) -> list[str]:
    """List the given keys with their descriptions and their values in a config."""
    raw: Any = OmegaConf.to_container(cfg, resolve=False)
    lines = []
    for key in keys:
        value = reduce(getitem, key.name.split("."), raw)
        if isinstance(value, str) and value in UNTYPED:
            value = UNTYPED[value]
        elif str(value).startswith("${"):
            value = OmegaConf.select(cfg, key.name)
        lines += two_columns(f"{key.name}={as_typed(value)}", key.meaning)
    return lines


def _names(group: str, folders: Sequence[Path]) -> list[str]:
    """List the names of a group's members, both plugins and presets."""
    presets = [name for folder in folders for name in presets_of(folder / group)]
    return sorted({plugin.name for plugin in plugins(group)} | set(presets))


def _members(group: str, folders: Sequence[Path]) -> Iterator[str]:
    """List the presets of a group, one line each."""
    rows: dict[str, str] = {}
    for folder in folders:
        rows |= presets_of(folder / group)
    for name, summary in sorted(rows.items()):
        yield from two_columns(name, summary.partition(" Run: ")[0])


def _group(group: str, cfg: DictConfig, folders: Sequence[Path], with_options: bool) -> list[str]:
    """List a group's members, one per line; ``with_options`` adds facts about each, and the chosen members' options."""
    rows = {plugin.name: plugin.summary for plugin in plugins(group)}
    for folder in folders:
        rows |= presets_of(folder / group)
    lines = [f"{group}: {FAMILIES.get(group) or PRESETS[group]}"]
    facts = {plugin.name: plugin.facts for plugin in plugins(group) if with_options}
    for name, summary in sorted(rows.items()):
        lines += two_columns(name, summary)
        if facts.get(name):
            lines += two_columns("", " · ".join(f"{fact}: {value}" for fact, value in facts[name].items()))
    node = cfg.get(group)
    chosen = [] if not with_options or node is None else list(node.values()) if group in MULTI_SELECT else [node]
    for plugin in plugins(group):
        for options in [options for options in chosen if options.get("_target_") == plugin.target]:
            lines.append(f"  options of {group}={plugin.name}, and their current values")
            for option, about in plugin.meanings.items():
                lines += two_columns(f"{plugin.path}.{option}={as_typed(options[option])}", about)
    return lines


def two_columns(name: str, meaning: str, column: int = COLUMN) -> list[str]:
    """Format a name and its description in two columns, or on separate lines if the name is too long."""
    meaning = plain(meaning)
    head = f"  {name:<{column - 3}} "
    if len(head) > column:
        indent = " " * column
        return [head, *fill(meaning, LINE_WIDTH, initial_indent=indent, subsequent_indent=indent).splitlines()]
    return fill(head + meaning, LINE_WIDTH, subsequent_indent=" " * column).splitlines()
