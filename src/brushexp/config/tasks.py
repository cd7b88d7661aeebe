"""Look up tasks by name, both core tasks and tasks of installed packages."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from typing import Any

from brushexp.config.schema import ExportTask, PaintTask, Task
from brushexp.config.vocabulary import STAND_INS, TASK_POINTS
from brushexp.registry.plugin import import_or_explain
from brushexp.system.published import entry_points_of


class Tasks(Mapping[str, type[Task]]):
    """A mapping from names to tasks; a package's task is imported on first access."""

    def __init__(self, own: Mapping[str, type[Task]]) -> None:
        self._loaded = dict(own)

    def __iter__(self) -> Iterator[str]:
        return iter(dict.fromkeys([*self._loaded, *entry_points_of(TASK_POINTS)]))

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __contains__(self, name: object) -> bool:
        return name in self._loaded or name in entry_points_of(TASK_POINTS)

    def __getitem__(self, name: str) -> type[Task]:
        """Return a task; if its module cannot be imported, raise a UserError that explains why."""
        if name not in self._loaded:
            point = entry_points_of(TASK_POINTS)[name]
            self._loaded[name] = import_or_explain(point.load, f"entry point {name} ({point.value})")
        return self._loaded[name]


TASKS = Tasks({"paint": PaintTask, "export": ExportTask})


def stand_ins_of(name: str) -> list[str]:
    """List the tasks that can replace a task; each does so if its `Task.suits` returns True."""
    points = (point.partition(".") for point in entry_points_of(STAND_INS))
    return [other for of, _, other in points if of == name]


def task_for(name: str, values: Mapping[str, Any]) -> str:
    """Return the task that replaces the named task for the given values; usually it is the same task.

    >>> task_for("paint", {"image": "clip.mp4"}), task_for("paint", {"image": "photo.jpg"})
    ('film', 'paint')
    """
    suiting = [other for other in stand_ins_of(name) if TASKS[other].suits(values)]
    return max(suiting, key=lambda other: _count_known(TASKS[other], values), default=name)


def _count_known(task: type[Task], values: Mapping[str, Any]) -> int:
    """Count how many of the keys in ``values`` a task has.

    If several tasks are suitable, the one with the highest count is chosen.
    """
    return len({field.name for field in fields(task)} & values.keys())


def add_task(words: Sequence[str]) -> list[str]:
    """Add ``task=`` to a command line whose arguments call for a task other than the one they name or imply."""
    typed: dict[str, str] = {}
    for name, _, value in (word.partition("=") for word in words):
        typed[name] = f"{typed[name]},{value}" if name in typed else value  # several pictures, as in a sweep
    named = typed.get("task", "paint")
    other = task_for(named, typed)
    if other == named:
        return [*words]
    first = next(k for k, word in enumerate(words) if word.partition("=")[0] in typed and "=" in word)
    others = [word for word in words if word != f"task={named}"]
    return [*others[:first], f"task={other}", *others[first:]]
