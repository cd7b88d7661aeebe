"""Keep a manifest of the files that runs create in a folder, because ``overwrite=true`` may remove only these files.

Python's audit hooks (PEP 578) report every file that is about to be opened or renamed, including the files of Hydra,
Lightning and plugins. C libraries report nothing, so their files go through `replacing`, which renames them, or
`note_files`.
"""

import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

from brushexp.system.files import TEMPORARY

METRICS_FILE = "metrics.json"  # status and metrics of a run
CHECKPOINT = "checkpoint.ckpt"  # exists while a run is unfinished
MANIFEST = ".hydra/files.txt"  # one relative path per line
UNNOTED = ("files.txt", "lock", "report.lock")  # files that belong to a folder, not to its runs
_recorded: set[str] = set()  # real paths of folders


def record_files(folder: Path) -> None:
    """Start adding every file that this process creates below a folder to that folder's manifest."""
    _install_hook()
    _recorded.add(os.path.realpath(folder))
    (folder / MANIFEST).touch()


def stop_recording(folder: Path) -> None:
    """Stop recording the files created below a folder."""
    _recorded.discard(os.path.realpath(folder))


@contextmanager
def recorded(folder: Path) -> Iterator[None]:
    """Record every file created below a folder within the ``with`` block."""
    record_files(folder)
    try:
        yield
    finally:
        stop_recording(folder)


def note_files(folder: Path, paths: Iterable[Path]) -> None:
    """Add files below a folder to its manifest if the folder is being recorded."""
    if os.path.realpath(folder) not in _recorded:
        return
    names = [os.path.relpath(path, folder) for path in paths]
    lines = [f"{name}\n" for name in names if not name.startswith("..") and "\n" not in name]
    with (folder / MANIFEST).open("a", encoding="utf-8", errors="surrogateescape") as manifest:
        manifest.write("".join(lines))


def files_written(folder: Path) -> Iterator[Path]:
    """Yield the existing files that runs created in a folder, including the files of a sweep's jobs."""
    manifest, root = folder / MANIFEST, folder.resolve()
    if not manifest.is_file():
        return
    for name in dict.fromkeys(manifest.read_text(encoding="utf-8", errors="surrogateescape").splitlines()):
        path = folder / name
        if not path.parent.resolve().is_relative_to(root) or ".." in path.parts[len(folder.parts) :]:
            continue  # a manifest is untrusted
        if path.name == manifest.name and path.parents[1] != folder:  # this is the manifest of a job
            yield from files_written(path.parents[1])
        if path.is_file() or path.is_symlink():
            yield path


@cache
def _install_hook() -> None:
    sys.addaudithook(_on_event)  # installed only once, because Python cannot remove hooks


def _on_event(event: str, arguments: tuple[Any, ...]) -> None:
    """Add a new file to the manifest when an audit event reports it below a recorded folder."""
    if not _recorded or event not in ("open", "os.rename"):
        return
    path, flags = (arguments[0], arguments[2]) if event == "open" else (arguments[1], os.O_CREAT)
    if isinstance(path, int) or not flags & os.O_CREAT or os.path.lexists(path):
        return
    whole = os.path.join(os.path.realpath(os.path.dirname(os.fsdecode(path))), os.path.basename(os.fsdecode(path)))
    if os.path.basename(whole) in UNNOTED or f"{os.sep}{TEMPORARY[:-1]}" in whole:
        return
    around = [folder for folder in tuple(_recorded) if whole.startswith(f"{folder}{os.sep}")]
    if around:
        with suppress(OSError):  # the code that opens the file reports a full disk
            note_files(Path(max(around, key=len)), [Path(whole)])
