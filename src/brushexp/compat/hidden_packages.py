"""Hide what Lightning 2.6 says that no user can act on, and packages that lightning_utilities loads for nothing."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.machinery import ModuleSpec
from importlib.metadata import PackageNotFoundError
from unittest.mock import patch

# Patterns of warnings: a name that torch deprecates, and networks that are frozen on purpose.
REMARKS = ".*LeafSpec|.*in eval mode at the start of training"


@contextmanager
def hidden(*packages: str) -> Iterator[None]:
    """Let packages that are not loaded yet look to lightning_utilities as if they were not installed.

    torchmetrics, and so Lightning, loads SciPy's signal processing and matplotlib wherever it finds them, which takes
    two fifths of the time to import Lightning. Whoever imports them by name gets them.
    """
    from lightning_utilities.core import imports  # noqa: PLC0415  (only runs need it)

    installed, find = imports._version, imports.find_spec  # type: ignore[attr-defined]
    fresh = [name for name in packages if name not in sys.modules]

    def version(name: str) -> str:
        if name in fresh:
            raise PackageNotFoundError(name)
        return installed(name)

    def spec(name: str) -> ModuleSpec | None:
        return None if name in fresh else find(name)

    with patch.multiple(imports, _version=version, find_spec=spec):
        yield
