"""Record the SHA-256 digests of users' plugin files when they are imported."""

import sys
from collections.abc import Iterable
from pathlib import Path

from brushexp.registry.families import USER_PACKAGE
from brushexp.system.reading import digest_of

_digests: dict[str, str] = {}  # module -> SHA-256 of its file at the time when one of its plugins was registered


def note_source(cls: type) -> None:
    """Record the SHA-256 digests of the files behind a class that is being registered."""
    for module in modules_behind(cls):
        path = file_of(module)
        if path is not None and path.is_file():
            _digests[module] = digest_of(path)


def file_of(module: str) -> Path | None:
    """Return the file of an imported module, or None for a notebook cell."""
    path = getattr(sys.modules.get(module), "__file__", None)
    return None if path is None else Path(path)


def place_of(cls: type) -> str:
    """Return the file in which a class is defined, or its module if there is no file, for use in messages."""
    return str(file_of(cls.__module__) or cls.__module__)


def modules_behind(cls: type) -> list[str]:
    """Return the modules of a class and of its bases in the same package, and the package's loaded private modules."""
    package = cls.__module__.partition(".")[0]
    bases = [base.__module__ for base in cls.__mro__ if base.__module__.partition(".")[0] == package]
    begin = f"{package}."
    helpers = [name for name in sys.modules if name.startswith(begin) and name.rpartition(".")[2][:1] == "_"]
    return list(dict.fromkeys([*bases, *sorted(helpers)]))


def digests_of(classes: Iterable[type]) -> dict[str, str]:
    """Map the files behind classes (``sobel.py``, or ``package/module.py`` if installed) to their SHA-256 digests."""
    modules = [module for cls in classes for module in modules_behind(cls)]
    return {_file_name(module): _digests[module] for module in modules if module in _digests}


def _file_name(module: str) -> str:
    """Return the name of a module's file without the path to it on this machine."""
    name = module.removeprefix(f"{USER_PACKAGE}.").replace(".", "/")
    return f"{name}.py" if module != "__main__" else Path(str(file_of(module))).name
