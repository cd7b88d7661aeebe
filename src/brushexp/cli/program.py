"""What runs between a command line and a task: plugins are loaded, Hydra composes, jobs begin."""

import os
import sys
import time
from pathlib import Path

import hydra
from omegaconf import DictConfig

from brushexp.cli.command_line import asks_for_help, explained, in_full, prepare
from brushexp.config.configs import folders_of, search_path, without_folder

_prepared: set[int] = set()  # processes that have loaded the plugins
_start = [time.monotonic()]  # of the program


@hydra.main(version_base="1.3", config_path="pkg://brushexp.conf", config_name="config")
def job(cfg: DictConfig) -> dict[str, object] | float:
    """Run the task of a config; its numbers, or that of its objective. A process of a parallel sweep begins here."""
    if os.getpid() not in _prepared:
        prepare(Path())
        _prepared.add(os.getpid())
    from brushexp.runs.runner import run_task  # noqa: PLC0415  (Lightning takes seconds to import; --help should not)

    return run_task(cfg, _start[0])


def run(start: float) -> None:
    """Run the program with the words of its command line; ``start`` is `time.monotonic` when it began."""
    _start[0] = start
    with explained(words := sys.argv[1:]):
        prepare(Path(), words)  # before Hydra, which reads the choices when it composes
        _prepared.add(os.getpid())
        if not asks_for_help(in_full(words)):
            sys.argv[1:] = without_folder(in_full(words)) + search_path(folders_of(Path(), words))
            job()
