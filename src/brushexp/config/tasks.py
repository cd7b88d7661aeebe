"""List all tasks by name: those of the program, and those that installed packages publish."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from importlib.metadata import entry_points
from typing import Any

from brushexp.config.schema import Task
from brushexp.config.vocabulary import TASK_POINTS
from brushexp.plugin_loading import import_or_explain

TASKS: dict[str, type[Task]] = {task.__name__.removesuffix("Task").lower(): task for task in Task.__subclasses__()}


def load_tasks() -> None:
    """Add the tasks of installed packages; a UserError says which one cannot be imported."""
    for point in entry_points(group=TASK_POINTS):
        TASKS[point.name] = import_or_explain(point.load, f"entry point {point.name} ({point.value})")


def task_for(name: str, values: Mapping[str, Any]) -> str:
    """Find the task that takes the place of a task for such values; mostly it is the task itself.

    >>> task_for("paint", {"image": "clip.mp4"}), task_for("paint", {"image": "photo.jpg"})
    ('film', 'paint')
    """
    suiting = [other for other, task in TASKS.items() if task.instead_of == name and task.suits(values)]
    return max(suiting, key=lambda other: _count_known(TASKS[other], values), default=name)


def _count_known(task: type[Task], values: Mapping[str, Any]) -> int:
    """Count the keys among ``values`` that a task has: of several that suit, the one that knows most is meant."""
    return len({field.name for field in fields(task)} & values.keys())


def add_task(words: Sequence[str]) -> list[str]:
    """Add ``task=`` of the task that suits the words of a command line, if it is not named."""
    typed: dict[str, str] = {}
    for name, _, value in (word.partition("=") for word in words):
        typed[name] = f"{typed[name]},{value}" if name in typed else value  # several pictures are joined, as in a sweep
    named = typed.get("task", "paint")
    other = task_for(named, typed)
    if other == named:
        return [*words]
    first = next(k for k, word in enumerate(words) if word.partition("=")[0] in typed and "=" in word)
    others = [word for word in words if word != f"task={named}"]
    return [*others[:first], f"task={other}", *others[first:]]
