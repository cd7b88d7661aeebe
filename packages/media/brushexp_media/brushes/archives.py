"""Read brushes out of archives: brushes of Procreate (.brush, .brushset) and bundles of Krita (.bundle)."""

import re
import zipfile
from collections.abc import Iterator
from io import BytesIO
from pathlib import PurePosixPath

from brushexp.contracts import UserError

SHAPES = {  # ending of an archive -> the files in it that are brushes
    ".brush": re.compile(r"(?:[^/]+/)?Shape\.png"),
    ".brushset": re.compile(r"[^/]+/Shape\.png"),
    ".bundle": re.compile(r"brushes/(?:[^/]+/)*[^/]+\.(?:gbr|gih|abr|png)", re.IGNORECASE),
}
LARGEST_FILE = 64 * 2**20  # bytes of a brush in an archive
BUILT_IN = "names brushes that are built into its program and brings none; paint a stroke with it and save that as PNG"


def brushes_in(data: bytes, ending: str) -> Iterator[tuple[str, bytes]]:
    """Yield names and contents of the brushes in an archive, by the ending of its name.

    A UserError if it cannot be read, or has no brush.
    """
    try:
        with zipfile.ZipFile(BytesIO(data)) as archive:
            names = sorted(name for name in archive.namelist() if SHAPES[ending].fullmatch(name))
            if not names:
                raise UserError(BUILT_IN)
            for name in names:
                if archive.getinfo(name).file_size > LARGEST_FILE:
                    raise UserError(f"has a brush of more than {LARGEST_FILE >> 20} MB, {name}; leave that one out")
                yield _short(name), archive.read(name)
    except (zipfile.BadZipFile, zipfile.LargeZipFile, NotImplementedError, RuntimeError, EOFError, OSError) as error:
        raise UserError(f"is damaged, or no archive of brushes ({error}); save it anew from its program") from error


def _short(name: str) -> str:
    """Name a brush in an archive by its file; all of Procreate's are Shape.png, so by their folders."""
    path = PurePosixPath(name)
    return f"{path.parent.name or 'brush'}.png" if path.name == "Shape.png" else path.name
