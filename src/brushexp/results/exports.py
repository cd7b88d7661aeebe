"""The exports of a run: files beside its painting, and in ``exports`` a folder for the records of each export.

An export notes in its metrics.json, as ``files``, which file of the run is of which format.
"""

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from brushexp.errors import UserError
from brushexp.strokes.storage import CATALOGUE_NAME
from brushexp.system.reading import json_of, read_text
from brushexp.system.run_files import MANIFEST, METRICS_FILE, note_files, recorded

FOLDER = "exports"  # in the folder of a run


def run_around(catalogue: str) -> Path | None:
    """Return the folder of the run whose painting this is, a folder or its catalogue.h5; None of any other file.

    It is also None if nothing can be written into the folder.
    """
    path = Path(catalogue).expanduser()
    folder = path if path.is_dir() else path.parent
    is_run = (folder / METRICS_FILE).is_file() and (folder / CATALOGUE_NAME).is_file()
    return folder if is_run and os.access(folder, os.W_OK) else None


def exported(run: Path) -> dict[Path, str]:
    """Map each file that earlier exports have written beside a painting, and that still exists, to its format."""
    files: dict[Path, str] = {}
    for record in sorted((run / FOLDER).glob(f"*/{METRICS_FILE}")):
        try:
            noted = json_of(read_text(record, ""))["files"]
            files |= {run / Path(name).name: str(kind) for kind, names in noted.items() for name in names}
        except (UserError, KeyError, TypeError, AttributeError):
            continue  # of an export that went elsewhere, or damaged
    return {path: kind for path, kind in files.items() if path.is_file()}


def check_exports(run: Path, kinds: Iterable[str]) -> None:
    """Refuse (UserError) an export in formats of which earlier files lie beside the painting."""
    for path, kind in exported(run).items():
        if kind in kinds:
            raise UserError(
                f"{path} is of an earlier export; replace it with overwrite=true, or choose another folder: output=..."
            )


def move_beside(paths: Sequence[Path], run: Path) -> list[Path]:
    """Move new files of an export beside the painting, and return where they are.

    A file that an earlier export has written is replaced. Next to any other file of the same name, such as
    ``painting.png`` of the painting itself, the new one is ``painting_export.png``. If that name is taken, too, the
    file stays where it is.
    """
    earlier, moved = exported(run), []
    for path in paths:
        plain = run / path.name
        names = (plain, plain.with_name(f"{path.stem}_export{path.suffix}"))
        free = [name for name in names if name in earlier or not os.path.lexists(name)]
        moved.append(path.replace(free[0]) if free else path)
    with recorded(run):  # so overwrite=true of the run removes them
        note_files(run, [*moved, *{path.parent / MANIFEST for path in paths}])
    return moved
