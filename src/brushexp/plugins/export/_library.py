"""vpype, which knows papers, plotters and orders of lines; it is optional, slow to import, and talks much."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType

from brushexp.errors import UserError


def the_library() -> ModuleType:
    """The module ``vpype``.

    Raises:
        UserError: if it is not installed.
    """
    try:
        with quiet():
            import vpype  # noqa: PLC0415
    except ImportError as error:
        raise UserError("to=hpgl and to=gcode need vpype, which is not here; pip install -e '.[plot]'") from error
    return vpype


@contextmanager
def quiet() -> Iterator[None]:
    """Keep out of our log what vpype says to the root logger: which files it reads, whenever it makes an index."""
    root = logging.getLogger()

    def not_of_vpype(record: logging.LogRecord) -> bool:
        return "vpype" not in record.pathname

    root.addFilter(not_of_vpype)
    try:
        yield
    finally:
        root.removeFilter(not_of_vpype)
