"""Manage a run's exports: the files next to its painting, and the folder in ``exports`` that records each export.

The ``files`` entry in an export's metrics.json maps formats to exported files.
"""

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from brushexp.errors import UserError
from brushexp.strokes.storage import CATALOGUE_NAME
from brushexp.system.reading import json_of, read_text
from brushexp.system.run_files import MANIFEST, METRICS_FILE, note_files, recorded

FOLDER = "exports"  # name of the folder in a run's folder


def run_around(catalogue: str) -> Path | None:
    """Return the run folder that ``catalogue`` names, either directly or as the catalogue.h5 in it.

    Returns None if the folder is not a run's folder or is read-only.
    """
    path = Path(catalogue).expanduser()
    folder = path if path.is_dir() else path.parent
    is_run = (folder / METRICS_FILE).is_file() and (folder / CATALOGUE_NAME).is_file()
    return folder if is_run and os.access(folder, os.W_OK) else None


def exported_files(run: Path) -> dict[Path, str]:
    """Return the existing files that earlier exports wrote next to a painting, each mapped to its format."""
    files: dict[Path, str] = {}
    for record in sorted((run / FOLDER).glob(f"*/{METRICS_FILE}")):
        try:
            noted = json_of(read_text(record, ""))["files"]
            files |= {run / Path(name).name: str(kind) for kind, names in noted.items() for name in names}
        except (UserError, KeyError, TypeError, AttributeError):
            continue  # the records are damaged or belong to an export to another folder
    return {path: kind for path, kind in files.items() if path.is_file()}


def check_exports(run: Path, kinds: Iterable[str]) -> None:
    """Raise a UserError if an earlier export wrote a file in one of these formats next to the painting."""
    for path, kind in exported_files(run).items():
        if kind in kinds:
            raise UserError(
                f"{path} exists already; replace it with overwrite=true, or choose another folder: output=..."
            )


def move_beside(paths: Sequence[Path], run: Path) -> list[Path]:
    """Move an export's new files next to the painting, and return their paths.

    Files of earlier exports are replaced. If another file has the same name, such as the run's own ``painting.png``,
    the new file becomes ``painting_export.png``; if that name is also taken, the file is not moved.
    """
    earlier, moved = exported_files(run), []
    for path in paths:
        plain = run / path.name
        names = (plain, plain.with_name(f"{path.stem}_export{path.suffix}"))
        free = [name for name in names if name in earlier or not os.path.lexists(name)]
        moved.append(path.replace(free[0]) if free else path)
    with recorded(run):  # so that the run's overwrite=true removes them
        note_files(run, [*moved, *{path.parent / MANIFEST for path in paths}])
    return moved
