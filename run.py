"""Entry point: ``python run.py image=photo.jpg strokes=8000``; add ``-m`` to sweep, ``--help`` to see the choices."""

import gc
import os
import sys
import time
from pathlib import Path

START = time.monotonic()  # before the slow imports, which count
gc.disable()  # until the task begins: nothing of a module is garbage, and to look for it takes a seventh of the start

import hydra  # noqa: E402
from omegaconf import DictConfig  # noqa: E402

from brushexp.app.command_line import asks_for_help, explained, in_full, prepare  # noqa: E402

HERE = Path(__file__).parent
prepared: set[int] = set()  # processes that have loaded the plugins


@hydra.main(version_base="1.3", config_path="conf", config_name="config")
def main(cfg: DictConfig) -> dict[str, object]:
    """Run the task that the config names and return its numbers."""
    if os.getpid() not in prepared:  # of a parallel sweep
        prepare(HERE)
    from brushexp.app.runner import run_task  # noqa: PLC0415  (Lightning takes seconds to import; --help should not)

    return run_task(cfg, START)


if __name__ == "__main__":
    with explained(HERE):
        prepare(HERE, sys.argv[1:])  # before main(): Hydra reads the choices when it composes
        sys.argv[1:] = in_full(sys.argv[1:])
        prepared.add(os.getpid())
        if not asks_for_help(HERE, sys.argv[1:]):
            main()
