"""Write the text of ``--help``: every key of the task with its meaning, and every plugin that can be chosen."""

from collections.abc import Sequence
from functools import reduce
from itertools import chain
from operator import getitem
from pathlib import Path
from textwrap import fill
from typing import Any

from omegaconf import DictConfig, OmegaConf

from brushexp.config.check import words_of
from brushexp.config.compose import presets_of
from brushexp.config.keys import groups_of, keys_of
from brushexp.config.schema import PaintTask
from brushexp.config.tasks import TASKS
from brushexp.config.vocabulary import words_of_changes
from brushexp.config.words import as_typed
from brushexp.pictures.load import samples
from brushexp.registry import FAMILIES, plugins

INTRODUCTION = """Paint pictures out of brush strokes by gradient descent, and study how well that works.

  brushexp photo.jpg                              paint a picture, in oil; without a word: a sample
  brushexp photo.jpg watercolour                  another look: look=watercolour
  brushexp photo.jpg finer                        smaller strokes; bolder: larger ones; fine, best: with more time
  brushexp photo.jpg style=painting.jpg           in the style of a painting: its colours and its strokes
  brushexp photo.jpg brush=stroke.png             with a brush of your own: a scanned stroke, or a .gbr of GIMP
  brushexp -m loss=mse,perceptual init=grid,slic  a sweep: one table, one sheet of pictures
  brushexp experiment=loss_by_init                a named study
  brushexp photos/                                every picture of a folder, some at a time (jobs=2: two): one page
  brushexp pictures=thesis12 look=ink             a set of pictures, conf/pictures/thesis12.yaml: one page
  brushexp export outputs/x resolution=4096       a finished painting at any size; to=svg,pdf: in other forms
  brushexp view                                   look at the newest run in the browser
"""
PATHS = {"image": "photo.jpg", "catalogue": "outputs/x", "runs": "outputs"}  # examples of what stands alone in a task
MORE = "More: README.md and docs/ (a plugin is one file). The whole config: --cfg job. Hydra's own flags: --hydra-help."
WIDTH = 120  # letters of a line
COLUMN = 28  # letters up to a meaning


def help_text(cfg: DictConfig, overrides: Sequence[str], folders: Sequence[Path]) -> str:
    """Write the help for a composed config and the typed overrides; presets are in the folders."""
    schema = TASKS[cfg.task]
    lines = [f"task={cfg.task}: {schema.__doc__}", "", "Its keys and their values now, key=value:"]
    lines = [INTRODUCTION if issubclass(schema, PaintTask) else usage_of(cfg.task, schema.alone), *lines]
    raw: Any = OmegaConf.to_container(cfg, resolve=False)
    typed = {word.lstrip("+~").partition("=")[0].partition(".")[0] for word in overrides}
    for name, key in keys_of(schema).items():
        if name.startswith("trainer.") and "trainer" not in typed:
            continue  # twenty keys of Lightning
        value = reduce(getitem, name.split("."), raw)
        value = OmegaConf.select(cfg, name) if str(value).startswith(("${scaled:", "${by_checkpoint:")) else value
        lines += two_columns(f"{name}={as_typed(value)}", key.meaning)
    lines += word_lines(cfg)
    about = "a family that you type shows options and what to choose by: renderer=neural --help"
    lines += ["", f"Its plugins, family=name; {about}"]
    for group in groups_of(schema):
        lines += group_lines(group, cfg, folders, group in typed and group in FAMILIES)
    if schema.alone == "image":
        lines += ["", *fill(f"Samples, in place of a picture: {', '.join(sorted(samples()))}", WIDTH).splitlines()]
    lines += ["", "Other tasks; their keys: task=name --help"]
    for name, other in TASKS.items():
        lines += two_columns(name, (other.__doc__ or "").partition("\n")[0])
    return "\n".join([*lines, "", MORE])


def word_lines(cfg: DictConfig) -> list[str]:
    """List the words for options of changes, with the values of those that are chosen."""
    words = words_of(TASKS[cfg.task])
    options = {option: word for word, option in words.items()}
    for word, tuned in words_of_changes("tunes").items():
        options |= {option: word for option in tuned} if words else {}
    lines: dict[str, list[str]] = {}
    for plugin in plugins("change"):
        is_taken = cfg.task == "paint" or plugin.cls.only_ends
        for option, meaning in plugin.meanings.items() if is_taken else ():
            if word := options.get(f"{plugin.path}.{option}"):
                value = OmegaConf.select(cfg, f"{plugin.path}.{option}")
                lines.setdefault(word, two_columns(f"{word}={as_typed(value)}", meaning.rstrip(".")))
    about = "Words for what is different about one painting, its changes; null: not chosen"
    return ["", about, *chain.from_iterable(lines.values())] if lines else []


def usage_of(task: str, alone: str) -> str:
    r"""Write how a task that does not paint is typed.

    >>> usage_of("export", "catalogue"), usage_of("train", "")
    ('brushexp export outputs/x [key=value ...]\n', 'brushexp train [key=value ...]\n')
    """
    return " ".join(["brushexp", task, *([PATHS[alone]] if alone in PATHS else []), "[key=value ...]\n"])


def group_lines(group: str, cfg: DictConfig, folders: Sequence[Path], with_options: bool) -> list[str]:
    """List the members of a group, one line each, and the options of the chosen ones."""
    rows = {plugin.name: plugin.summary for plugin in plugins(group)}
    for folder in folders:
        rows |= presets_of(folder / group)
    lines = [f"{group}: {FAMILIES.get(group, 'presets of the keys above')}"]
    facts = {plugin.name: plugin.facts for plugin in plugins(group) if with_options}
    for name, summary in sorted(rows.items()):
        lines += two_columns(name, summary)
        if facts.get(name):
            lines += two_columns("", " · ".join(f"{fact}: {value}" for fact, value in facts[name].items()))
    node = cfg.get(group)
    chosen = [] if not with_options or node is None else [node] if "_target_" in node else list(node.values())
    for plugin in plugins():
        for options in [options for options in chosen if options.get("_target_") == plugin.target]:
            lines.append(f"  options of {group}={plugin.name}:")
            for option, about in plugin.meanings.items():
                lines += two_columns(f"{plugin.path}.{option}={as_typed(options[option])}", about)
    return lines


def two_columns(name: str, meaning: str) -> list[str]:
    """Write a name and its meaning in two columns, or in two lines if the name is long."""
    head = f"  {name:<{COLUMN - 3}} "
    if len(head) > COLUMN:
        return [head, *fill(meaning, WIDTH, initial_indent=" " * COLUMN, subsequent_indent=" " * COLUMN).splitlines()]
    return fill(head + meaning, WIDTH, subsequent_indent=" " * COLUMN).splitlines()
