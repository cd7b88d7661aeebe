"""Declare each key of a task on one line (type, default, bounds and description), and rules that relate keys."""

from brushexp.config.changes import as_typed_word
from brushexp.config.keys import key, keys_of
from brushexp.config.looks import look_names
from brushexp.config.rules import CATALOGUE, canvas_of, check_monitors, check_painting
from brushexp.config.schema import RESUME, PaintTask, Task, TrainerOptions
from brushexp.pictures.load import PICTURE

__all__ = [
    "CATALOGUE",
    "PICTURE",
    "RESUME",
    "PaintTask",
    "Task",
    "TrainerOptions",
    "as_typed_word",
    "canvas_of",
    "check_monitors",
    "check_painting",
    "key",
    "keys_of",
    "look_names",
]
