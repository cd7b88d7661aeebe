"""All tasks by name: those of the program, and those that installed packages publish."""

from importlib.metadata import entry_points

from brushexp.config.schema import Task
from brushexp.plugin_loading import import_or_explain

ENTRY_POINTS = "brushexp.tasks"  # entry-point group: name of a task -> its subclass of `Task`
TASKS: dict[str, type[Task]] = {task.__name__.removesuffix("Task").lower(): task for task in Task.__subclasses__()}


def load_tasks() -> None:
    """Add the tasks of installed packages; a UserError says which one cannot be imported."""
    for point in entry_points(group=ENTRY_POINTS):
        TASKS[point.name] = import_or_explain(point.load, f"entry point {point.name} ({point.value})")
