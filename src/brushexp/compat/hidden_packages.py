"""Hide Lightning 2.6 warnings that users cannot act on, and packages that Lightning would import needlessly."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.machinery import ModuleSpec
from importlib.metadata import PackageNotFoundError
from unittest.mock import patch

# Patterns of warnings about a name that torch deprecates and about networks that are frozen on purpose.
REMARKS = ".*LeafSpec|.*in eval mode at the start of training"


@contextmanager
def hide_packages(*packages: str) -> Iterator[None]:
    """Make packages that are not loaded yet look uninstalled to lightning_utilities.

    Lightning imports torchmetrics, which imports matplotlib and SciPy's signal processing if they are installed. These
    imports take two fifths of Lightning's import time. Explicit imports still work.
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
