"""Define the config keys of ``task=studio`` and ``task=view``."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from omegaconf import DictConfig

from brushexp.contracts import Rule, between
from brushexp.contracts.tasks import Task, canvas_of, key

PAGE = Rule(lambda path, option: Path(path).is_dir() or canvas_of(path, option))


@dataclass
class StudioTask(Task):
    """Paint photographs in the browser, on a page served on this machine until Ctrl-C."""

    module = "brushexp_studio.task"

    output: str = key("${scratch:}", "folder for the log; by default no log is kept")
    keep: str | None = key(None, "folder for finished paintings; null = delete them when the studio closes")
    port: int = key(0, "port of the server, 1 to 65535; 0 = any free port", between(0, 65535))
    open: bool = key(True, "whether to open the page in the browser; false = only print the address")


@dataclass
class ViewTask(Task):
    """View a painting, a run or a sweep in the browser, on a page served on this machine until Ctrl-C."""

    module = "brushexp_studio.view"
    alone = "catalogue"
    groups: ClassVar[dict[str, Any]] = {"renderer": None, "blend": "tiled"}

    catalogue: str | None = key(None, "folder of a run or sweep, or a catalogue; null = the newest in outputs/", PAGE)
    output: str = key("${scratch:}", "folder for the page; by default it is not kept")
    port: int = key(0, "port of the server, 1 to 65535; 0 = any free port", between(0, 65535))
    open: bool = key(True, "whether to open the page in the browser; false = only print the address")

    @staticmethod
    def check(cfg: DictConfig, overrides: Sequence[str]) -> None:
        """Check that there is a page to view."""
        from brushexp_studio.view import newest_run  # noqa: PLC0415  (``--help`` does not need it)

        if cfg.catalogue is None:
            newest_run()
