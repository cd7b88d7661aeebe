"""Keys of ``task=studio``."""

from dataclasses import dataclass

from brushexp.bounds import between
from brushexp.config.keys import key
from brushexp.config.schema import Task


@dataclass
class StudioTask(Task):
    """Paint your own photographs in the browser, and watch: a page on this machine, until Ctrl-C."""

    module = "brushexp_studio.task"

    output: str = key("${scratch:}", "folder of the log; by default none is left")
    keep: str | None = key(None, "folder where finished paintings stay; null = they go with the page")
    port: int = key(0, "of this machine, 1 to 65535; 0 = any that is free", between(0, 65535))
    open: bool = key(True, "in the browser, or only print the address")
